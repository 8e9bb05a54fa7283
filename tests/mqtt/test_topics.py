"""Topics, and where answers may go."""

from __future__ import annotations

import pytest

from robotouille_server.mqtt.topics import Topics

TOPICS = Topics("lab")


def test_topics_have_the_servers_name_and_the_episodes_id() -> None:
    assert TOPICS.presence == "robotouille/v1/lab/presence"
    assert TOPICS.life("ad9a") == "robotouille/v1/lab/episodes/ad9a/life"
    assert TOPICS.steps("ad9a") == "robotouille/v1/lab/episodes/ad9a/steps"


def test_an_answer_goes_where_it_was_asked_for_below_the_answers() -> None:
    assert TOPICS.response_topic("robotouille/v1/lab/answers/me") == "robotouille/v1/lab/answers/me"


@pytest.mark.parametrize(
    "asked",
    [
        "",
        "home/front-door",
        "robotouille/v1/lab/presence",
        "robotouille/v1/lab/answers/",
        "robotouille/v1/lab/answers/+",
        "robotouille/v1/lab/answers/#",
        "robotouille/v1/lab/answers/\0",
        "robotouille/v1/lab/answers/" + "x" * 200,
        "robotouille/v1/other/answers/me",
    ],
)
def test_and_nowhere_else(asked: str) -> None:
    assert TOPICS.response_topic(asked) == TOPICS.answers
