"""Topics, and the AsyncAPI document that describes them."""

from __future__ import annotations

import json
import re

import pytest
from tools.mqtt_asyncapi import mqtt_asyncapi

from robotouille_server.mqtt.messages import COMMANDS, Topics
from tests.support.pages import read, table

TOPICS = Topics("lab")


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
def test_other_reply_topics_are_ignored(asked: str) -> None:
    assert TOPICS.reply_topic(asked) == TOPICS.answers


DOCUMENT = mqtt_asyncapi()


def test_channels_match_the_topics() -> None:
    topics = Topics("{server}")
    addresses = {channel["address"] for channel in DOCUMENT["channels"].values()}
    assert addresses == {
        topics.presence,
        topics.commands,
        topics.answers,
        f"{topics.answers}/{{name}}",
        topics.life("{episode}"),
        topics.steps("{episode}"),
    }
    for channel in DOCUMENT["channels"].values():
        assert set(re.findall(r"\{(\w+)\}", channel["address"])) == set(channel["parameters"])


def test_page_lists_every_topic_and_command() -> None:
    rows = {
        row[0].replace("SERVER", "{server}").replace("ID", "{episode}").replace("NAME", "{name}")
        for row in table("mqtt.md", "Topics")
    }
    assert {row.replace("`", "") for row in rows} == {
        channel["address"] for channel in DOCUMENT["channels"].values()
    }
    kinds = {kind for row in table("mqtt.md", "Commands") for kind in row[0].split(", ")}
    assert {kind.strip("`") for kind in kinds} == {
        model.model_json_schema()["properties"]["type"]["const"] for model in COMMANDS
    }


@pytest.mark.parametrize("payload", re.findall(r"^\{.*\}$|'(\{.*\})'", read("mqtt.md"), re.M))
def test_examples_are_json(payload: str) -> None:
    if payload:
        assert json.loads(payload.replace("'$TOKEN'", "token"))
