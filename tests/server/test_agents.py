"""Bots that take seats: which games they choose, what is recorded of them, and rematches."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from robotouille import GroundAction, RobotouilleError, State, WrongWorldError
from robotouille.protocol.messages import Create
from robotouille.replay import read_recording
from robotouille_client.bots.kinds import BotKind, BotSetup, TrainedBot, policy_maker
from robotouille_client.bots.seat_policy import play
from robotouille_client.bots.seat_session import SeatRequest, play_seat
from robotouille_client.client import connect
from tests.support.servers import serving
from tests.support.sources import ROOT
from tests.support.virtual_time import virtual


def bot_that_stays(url: str, code: str) -> asyncio.Task[Mapping[str, Any]]:
    """Let a bot play the first seat of a game and of its rematches."""
    request = SeatRequest(url, ("robo",), episode=code, seat="robot1", stay=True)
    return asyncio.create_task(play_seat(request, BotSetup(BotKind.RANDOM, seed=7)))


@virtual
async def test_bot_plays_rematches_until_nobody_asks_for_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(Create(task="multi_agent/01@2", max_steps=3))
        playing = bot_that_stays(server.url, room.code)
        async with connect(server.url, name="ada", kind="human") as ada:
            game = await ada.join(room.code, seat="robot2")
            for number in range(3):
                await play(game, policy_maker(BotKind.RANDOM))
                game = await ada.rematch() if number < 2 else game
            assert not playing.done()
        assert (await playing)["reason"] == "step_limit"
    recordings = [read_recording(path) for path in (tmp_path / "recordings").glob("*.rbt")]
    assert len(recordings) == 3
    for each in recordings:
        assert each.participants == {"robot1": ("robo", "bot"), "robot2": ("ada", "human")}
        assert [note["agent"] for note in each.notes() if note.get("agent")] == ["random seed=7"]


class ActOnly:
    """Policy as users write it, without `observe`."""

    def __init__(self, state: State, player: str) -> None:
        self.player = player

    def act(self, state: State) -> GroundAction:
        return state.actions(self.player)[0]


@virtual
async def test_a_policy_needs_no_observe(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
        created = await ada.create("synchronous/01", max_steps=3)
        game = await ada.join(created.code)
        make: Any = ActOnly
        assert (await play(game, make))["steps"] == 3


@virtual
async def test_bot_without_a_seat_in_the_rematch_returns_the_outcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(Create(task="multi_agent/01@2", max_steps=3))
        playing = bot_that_stays(server.url, room.code)
        async with connect(server.url, name="ada") as ada, connect(server.url, name="eve") as eve:
            await play(await ada.join(room.code, seat="robot2"), policy_maker(BotKind.RANDOM))
            rematch = await ada.rematch()
            await eve.join(rematch.code, seat="robot1")
            assert (await playing)["reason"] == "step_limit"


@virtual
async def test_agent_is_recorded_and_hidden(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(Create(task="synchronous/01", max_steps=3))
        async with connect(server.url, name="eve") as eve:
            watched = await eve.join(room.code, role="spectator")
            setup = BotSetup(BotKind.PLANNER, seed=7, skill="learner")
            await play_seat(SeatRequest(server.url, ("ada",), episode=room.code), setup)
            seen = [repr(event) async for event in watched]
            assert "ada" in repr(watched.seats)
            assert "learner" not in repr((seen, watched.seats, watched.outcome))
    (path,) = (tmp_path / "recordings").glob("*.rbt")
    recording = read_recording(path)
    assert recording.verify().ok
    agents = [note["agent"] for note in recording.notes() if note.get("agent")]
    assert agents[0].startswith("planner skill=learner reaction=1.0 pace=1.2")
    assert agents[0].endswith("seed=7")


@virtual
async def test_trained_policy_of_another_kitchen_takes_no_seat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bot = TrainedBot(ROOT / "examples/learning/weights/training_03_ippo_0.npz")
    async with serving(tmp_path / "recordings") as server:
        for task in ("multi_agent/02@2", "training/03@3"):
            room = server.lobby.create(Create(task=task))
            with pytest.raises(WrongWorldError, match=r"cannot play \w+/0\d_\w+ with [23] seats"):
                await play_seat(SeatRequest(server.url, ("ada",), episode=room.code), bot)
            assert not room.episode.record.used


@virtual
async def test_trained_policy_leaves_an_unknown_kitchen_that_it_cannot_play(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr("robotouille.domain.loading.task_names", lambda: ())
    bot = TrainedBot(ROOT / "examples/learning/weights/training_03_ippo_0.npz")
    async with serving(tmp_path / "recordings") as server:
        room = server.lobby.create(Create(task="multi_agent/02@2"))
        with pytest.raises(WrongWorldError, match="cannot play multi_agent/02"):
            await play_seat(SeatRequest(server.url, ("ada",), episode=room.code), bot)
        assert not any(seat.name for seat in room.episode.seats.values())


@virtual
async def test_bot_without_a_code_skips_games_that_it_cannot_play(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bot = BotSetup(BotKind.RANDOM, seed=7)
    async with serving(tmp_path / "recordings") as server:
        for limit in ({"sight": 2}, {"sight_blocked": True}):
            server.lobby.create(Create(task="synchronous/01", max_steps=3, **limit))
        with pytest.raises(RobotouilleError, match=r"see a part of the kitchen.*\(llm\) play them"):
            await play_seat(SeatRequest(server.url, ("ada",)), bot)
        server.lobby.create(Create(task="synchronous/02", max_steps=3))
        assert (await play_seat(SeatRequest(server.url, ("ada",)), bot))["reason"] == "step_limit"
        async with connect(server.url, name="eve") as eve:
            waiting = await eve.waiting_episode(partial=True)
            assert waiting is not None
            assert (waiting.sight, waiting.sight_blocked, waiting.limits_sight) == (2, False, True)
