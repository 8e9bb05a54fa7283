"""Options and limits of episodes."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille.episode import Chat, Clock, SeatTreatment
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_client import connect
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.episode_setup import EpisodeSetup
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import TaskFolder
from tests.support.handshakes import hello, mint_token, opened
from tests.support.lost_connections import cut
from tests.support.servers import Raw, crash, raw, serving
from tests.support.virtual_time import virtual

SETTINGS = ServerSettings(task="multi_agent/02", mode=Clock.LOCKSTEP, grace=7.0, seed=3)


def requested(**asked: Any) -> EpisodeSetup:
    return EpisodeSetup.requested(messages.Create(**asked), SETTINGS, TaskFolder())


def test_settings_are_the_defaults() -> None:
    setup = requested()
    assert (setup.task.name, setup.seed) == ("multi_agent/02_lettuce_tomato_burger", 3)
    assert (setup.rules.clock, setup.rules.grace) == (Clock.LOCKSTEP, 7.0)
    assert (setup.labels, setup.treatments) == ({}, {})


def test_message_overrides_settings() -> None:
    treatments = {"robot2": SeatTreatment(delay_ms=50)}
    setup = requested(
        task="multi_agent/01", seed=5, grace=1.0, move_budget=2.0, max_steps=9,
        labels={"pair": "p7"}, treatments=treatments,
    )  # fmt: skip
    assert setup.task.name.startswith("multi_agent/01")
    assert (setup.seed, setup.labels) == (5, {"pair": "p7"})
    rules = setup.rules
    assert (rules.grace, rules.move_budget, rules.max_steps) == (1.0, 2.0, 9)
    assert setup.treatments["robot2"].delay_ms == 50


def test_phrases_need_the_phrases_chat() -> None:
    assert requested(chat=Chat.PHRASES, phrases=["yes"]).rules.phrases == ("yes",)


@pytest.mark.parametrize(
    ("asked", "code", "field"),
    [
        ({"task": "multi_agent/99"}, "task/unknown", "task"),
        ({"task": "multi_agent/01", "seats": 9}, "task/invalid", "seats"),
        ({"chat": Chat.PHRASES}, "message/invalid-field", "phrases"),
        ({"treatments": {"robot9": SeatTreatment()}}, "seat/unknown", "treatments"),
        ({"tokens": True, "participants": {"robot9": "p7"}}, "seat/unknown", "participants"),
    ],
)
def test_invalid_options_are_refused(asked: dict[str, Any], code: str, field: str) -> None:
    with pytest.raises(ProtocolError) as refused:
        requested(**asked)
    assert (refused.value.code, refused.value.field) == (code, field)


TWO, ONE = "multi_agent/01", "synchronous/01"


@pytest.mark.parametrize(
    ("settings", "create", "budget"),
    [
        ({}, {"task": TWO}, 300.0),
        ({}, {"task": TWO, "clock": "turn"}, 300.0),
        ({}, {"task": TWO, "clock": "realtime", "thinking": "declared"}, 300.0),
        ({}, {"task": TWO, "clock": "realtime"}, None),
        ({}, {"task": ONE}, None),
        ({}, {"task": TWO, "move_budget": 0}, None),
        ({}, {"task": TWO, "move_budget": 7.5}, 7.5),
        ({}, {"task": ONE, "move_budget": 7.5}, 7.5),
        ({"move_budget": "0"}, {"task": TWO}, None),
        ({"move_budget": "60"}, {"task": TWO}, 60.0),
        ({"move_budget": "60"}, {"task": ONE}, 60.0),
        ({"move_budget": "60"}, {"task": TWO, "move_budget": 0}, None),
        ({"move_budget": "0"}, {"task": TWO, "move_budget": 5.0}, 5.0),
    ],
)
@virtual
async def test_budget_of_an_episode(
    tmp_path: Path, settings: dict[str, str], create: dict[str, Any], budget: float | None
) -> None:
    async with serving(tmp_path, **settings) as server, raw(server) as ada:
        created = await ada.ask({"type": "create", **create}, "created")
        assert server.lobby.find(created["code"]).episode.rules.move_budget == budget
        await ada.send({"type": "join", "episode": created["code"], "role": "spectator"})
        assert (await ada.expect("snapshot"))["clock"]["move_budget"] == budget


@pytest.mark.parametrize("clock", ["turn", "lockstep"])
@virtual
async def test_silent_participant_delays_others_for_at_most_five_minutes(
    tmp_path: Path, clock: str
) -> None:
    async with (
        serving(tmp_path) as server,
        raw(server, name="ada") as ada,
        raw(server, name="bob") as bob,
    ):
        created = await ada.ask({"type": "create", "task": TWO, "clock": clock}, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        await bob.ask({"type": "join", "episode": created["code"]}, "joined")
        room = server.lobby.find(created["code"])
        if clock == "lockstep":
            await bob.send({"type": "act", "seq": 1, "action": None})
        await asyncio.sleep(299.0)
        assert room.episode.step == 0
        await asyncio.sleep(2.0)
        assert room.episode.step == 1


@virtual
async def test_unlimited_budget_survives_a_restart(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        request = {"type": "create", "task": TWO, "move_budget": 0}
        created = await ada.ask(request, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        await bob.ask({"type": "join", "episode": created["code"]}, "joined")
        await crash(server)
    async with serving(tmp_path, seed=2) as server:
        assert server.lobby.find(created["code"]).episode.rules.move_budget is None


FIRST = "multi_agent/01"


@pytest.mark.parametrize(
    ("settings", "asked", "limit"),
    [
        ({}, {"clock": "realtime"}, 900),
        ({}, {"clock": "realtime", "step_rate": 10.0}, 1800),
        ({}, {"clock": "realtime", "max_steps": 70}, 70),
        ({"max_steps": 300}, {"clock": "realtime"}, 300),
        ({}, {"clock": "realtime", "timing": "benchmark"}, 500),
        ({}, {"clock": "lockstep"}, 500),
        ({}, {"clock": "lockstep", "timing": "people"}, 180),
        ({}, {"clock": "realtime", "task": "examples/pancakes"}, 500),
    ],
)
@virtual
async def test_step_limit(
    tmp_path: Path, settings: dict[str, Any], asked: dict[str, Any], limit: int
) -> None:
    async with (
        serving(tmp_path, **settings) as server,
        connect(server.url, name="ada", kind="human") as ada,
    ):
        options = {"task": FIRST, **asked}
        created = await ada.create(options.pop("task"), **options)
        (info,) = [one for one in await ada.episodes() if one.code == created.code]
        assert info.max_steps == limit


TASK = "multi_agent/02"


def test_default_countdown_is_three_seconds() -> None:
    assert ServerSettings().rules().countdown == 3.0
    assert ServerSettings(countdown=0.0).rules().countdown == 0.0


@virtual
async def test_countdown_is_announced_to_everybody(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    async with (
        serving(tmp_path, countdown=3.0) as server,
        connect(server.url, name="ada", kind="human") as ada,
        connect(server.url, name="bob", kind="bot") as bob,
    ):
        created = await ada.create(TASK, clock="realtime", step_rate=10.0)
        first = await ada.join(created.code)
        assert first.starts_at is None
        second = await bob.join(created.code)
        begins = second.starts_at
        assert second.phase == "waiting"
        assert begins is not None
        assert begins - loop.time() == pytest.approx(3.0, abs=0.1)
        await asyncio.sleep(0.5)
        assert first.starts_at == pytest.approx(begins, abs=0.1)
        await asyncio.sleep(2.4)
        assert (second.phase, second.step) == ("waiting", 0)
        await asyncio.sleep(0.2)
        assert (first.phase, second.phase) == ("running", "running")
        assert (first.starts_at, second.starts_at) == (None, None)


@virtual
async def test_countdown_waits_for_a_player_who_was_killed(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, countdown=3.0) as server,
        connect(server.url, name="bob", kind="human") as bob,
    ):
        async with connect(server.url, name="ada", kind="human") as ada:
            created = await ada.create(TASK, clock="realtime")
            await ada.join(created.code)
            cut(ada)
            ada.url = "ws://127.0.0.1:9"
            game = await bob.join(created.code)
            await asyncio.sleep(20)
            assert game.phase == "waiting"
            assert [seat.present for seat in game.seats] == [False, True]
            episode = server.lobby.find(created.code).episode
            assert (episode.step, episode.starts_at) == (0, None)


CREATE = {"type": "create", "task": "synchronous/01", "max_steps": 1}


async def play(connection: Raw, code: str) -> None:
    """Play the only step of an episode."""
    await connection.ask({"type": "join", "episode": code}, "joined")
    await connection.send({"type": "act", "seq": 1, "action": None})
    assert (await connection.expect("ended"))["outcome"]["reason"] == "step_limit"


@virtual
async def test_owner_at_the_limit_opens_one_after_another_ends(tmp_path: Path) -> None:
    async with serving(tmp_path, max_episodes_per_owner=1) as server:
        token = mint_token(server, Role.HOST)
        async with opened(server) as first, opened(server) as second:
            for connection in (first, second):
                await hello(connection, token=token)
            created = await first.ask(CREATE, "created")
            assert created["type"] == "created"
            for connection in (first, second):
                assert (await connection.ask(CREATE, "created"))["code"] == "rate/episodes"
            await play(first, created["code"])
            assert (await second.ask(CREATE, "created"))["type"] == "created"
            assert (await first.ask(CREATE, "created"))["code"] == "rate/episodes"


@virtual
async def test_other_owners_are_not_limited(tmp_path: Path) -> None:
    async with serving(tmp_path, max_episodes_per_owner=1) as server:
        other = server.tokens.mint_role(Role.HOST, "p-2", seconds=3600)
        for token in (mint_token(server, Role.HOST), other):
            async with opened(server) as connection:
                await hello(connection, token=token)
                assert (await connection.ask(CREATE, "created"))["type"] == "created"
                assert (await connection.ask(CREATE, "created"))["code"] == "rate/episodes"
