"""What a request asks for becomes a task and its rules, with the server's settings for the rest."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille.episode import Chat, Clock
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.rooms.directory.episode_setup import EpisodeSetup
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import TaskFolder

SETTINGS = ServerSettings(task="multi_agent/02", mode=Clock.LOCKSTEP, grace=7.0, seed=3)


def requested(**asked: Any) -> EpisodeSetup:
    return EpisodeSetup.requested(messages.Create(**asked), SETTINGS, TaskFolder())


def test_who_says_nothing_gets_what_the_settings_say() -> None:
    setup = requested()
    assert (setup.task.name, setup.seed) == ("multi_agent/02_lettuce_tomato_burger", 3)
    assert (setup.rules.clock, setup.rules.grace) == (Clock.LOCKSTEP, 7.0)
    assert (setup.labels, setup.treatments) == ({}, {})


def test_what_is_said_goes_before_the_settings() -> None:
    treatments = {"robot2": messages.SeatTreatment(delay_ms=50)}
    setup = requested(
        task="multi_agent/01", seed=5, grace=1.0, move_budget=2.0, max_steps=9,
        labels={"pair": "p7"}, treatments=treatments,
    )  # fmt: skip
    assert setup.task.name.startswith("multi_agent/01")
    assert (setup.seed, setup.labels) == (5, {"pair": "p7"})
    rules = setup.rules
    assert (rules.grace, rules.move_budget, rules.max_steps) == (1.0, 2.0, 9)
    assert setup.treatments["robot2"].delay_ms == 50


def test_phrases_go_with_their_chat() -> None:
    assert requested(chat=Chat.PHRASES, phrases=["yes"]).rules.phrases == ("yes",)


@pytest.mark.parametrize(
    ("asked", "code", "field"),
    [
        ({"task": "multi_agent/99"}, "task/unknown", "task"),
        ({"task": "multi_agent/01", "seats": 9}, "task/invalid", "seats"),
        ({"chat": Chat.PHRASES}, "message/invalid-field", "phrases"),
        ({"treatments": {"robot9": messages.SeatTreatment()}}, "seat/unknown", "treatments"),
        ({"tokens": True, "participants": {"robot9": "p7"}}, "seat/unknown", "participants"),
    ],
)
def test_what_cannot_be_had_is_named(asked: dict[str, Any], code: str, field: str) -> None:
    with pytest.raises(ProtocolError) as refused:
        requested(**asked)
    assert (refused.value.code, refused.value.field) == (code, field)
