"""One language model in several seats on a real server, and what others say to it there."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille.replay.controllers import controllers
from robotouille.replay.model_calls import model_calls
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import Game, connect
from robotouille_client.bots.cli import SeatChoice, _run
from robotouille_evaluation.agents.making import make_strategy, team_strategy
from robotouille_evaluation.agents.network import NetworkAgent
from robotouille_evaluation.agents.teams.joint import Joint
from robotouille_evaluation.agents.teams.team import Control, Each, Turns
from robotouille_evaluation.cli.bot import LanguageModelBot
from robotouille_evaluation.models import Model, ModelRequest, ScriptedModel
from robotouille_evaluation.models.valid_actions import valid_actions
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.realtime.network import RealTimeAgent
from robotouille_server.auth.roles import Role
from tests.support.newcomers import minted
from tests.support.servers import serving
from tests.support.team_cook import NOTHING, TeamCook
from tests.support.virtual_time import run

TEAM = "multi_agent/01_lettuce_burger"
LEAVE = 'Leave the game!\n\nValid Actions:\nLeave\n\nGoal: nothing"'


@cache
def pack() -> Pack:
    return build_own_pack()


def cook() -> TeamCook:
    instance = pack().instance(f"{TEAM}/default")
    return TeamCook(pack().plan(instance, World(pack().load(instance))))


def team(game: Game, control: Control, model: Model) -> NetworkAgent:
    strategy = team_strategy(pack(), "react-last-reasoning-action", "multi_agent", control)
    make = Joint if control == "joint" else Turns
    return NetworkAgent(game, make(strategy, model.complete))


def played(folder: Path, clock: str, control: Control, model: Model) -> tuple[Any, Recording]:
    """A game in which one model has all seats."""

    async def main() -> Mapping[str, Any]:
        async with serving(folder) as server, connect(server.url, name="m") as client:
            opened = await client.create(TEAM, clock=clock, max_steps=50)
            game = await client.join(opened.code, seats="all", view="both")
            assert game.own_seats == ("robot1", "robot2")
            return await team(game, control, model).play()

    outcome = run(main())
    (file,) = folder.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().identical
    return outcome, recording


@pytest.mark.parametrize("clock", ["lockstep", "turn"])
@pytest.mark.parametrize("control", ["turns", "joint"])
def test_one_model_plays_all_seats(tmp_path: Path, control: Control, clock: str) -> None:
    player = cook()
    answer = player.joint if control == "joint" else player.turns
    outcome, recording = played(tmp_path, clock, control, ScriptedModel(answer))
    assert outcome["reason"] == "goal"
    calls = list(model_calls(recording))
    assert len(calls) == len(player.asked)
    if clock == "lockstep":
        assert len(calls) == outcome["steps"] * (1 if control == "joint" else 2)
    assert ("In this step" in player.asked[1]) == (control == "turns" and clock == "lockstep")


def mock(control: Control) -> LanguageModelBot:
    how: dict[str, Any] = {"base_url": "", "transcript": None, "seed": 1, "temperature": None}
    asked: dict[str, Any] = {"prices": "", "timeout": None, "attempts": None}
    return LanguageModelBot.of("mock", strategy="react-none", control=control, **how, **asked)


@pytest.mark.parametrize("control", ["turns", "joint"])
def test_the_bot_of_the_command_line_takes_several_seats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, control: Control
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="host") as host:
            opened = await host.create(TEAM, clock="lockstep", max_steps=5)
            seats = ("robot1", "robot2")
            outcome = await _run(
                SeatChoice(server.url, ("m",), episode=opened.code, seats=seats), mock(control)
            )
            assert outcome["reason"] == "step_limit"

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert {call.player for call in model_calls(recording)} >= {"robot1"}
    assert controllers(recording)[1] == {"robot1": "model", "robot2": "model"}
    assert recording.verify().identical


@pytest.mark.parametrize("seats", ["robot1,robot2", "robot2,robot7"])
def test_seats_that_cannot_be_taken_say_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seats: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="host") as host:
            opened = await host.create(TEAM, clock="lockstep")
            await host.join(opened.code, seat="robot1")
            several = tuple(seats.split(","))
            with pytest.raises(RobotouilleError, match="the others in the game wait: take"):
                await _run(
                    SeatChoice(server.url, ("m",), episode=opened.code, seats=several),
                    mock("joint"),
                )

    run(main())


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_whoever_may_not_list_episodes_takes_several_seats_by_the_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="host") as host:
            code = (await host.create(TEAM, clock=clock, max_steps=5)).code
            token = minted(server, Role.PLAYER)
            playing = _run(SeatChoice(server.url, ("m",), token, code, seats="all"), mock("joint"))
            if clock == "lockstep":
                assert (await playing)["reason"] == "step_limit"
                return
            with pytest.raises(RobotouilleError, match="is played in real time, where each seat"):
                await playing
            (episode,) = await host.episodes()
            assert [seat.name for seat in episode.seats] == ["", ""]

    run(main())


def test_in_real_time_no_seat_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="host") as host:
            opened = await host.create(TEAM, clock="realtime")
            with pytest.raises(RobotouilleError, match="is played in real time, where each seat"):
                await _run(
                    SeatChoice(server.url, ("m",), episode=opened.code, seats="all"), mock("joint")
                )
            (episode,) = await host.episodes()
            assert [seat.name for seat in episode.seats] == ["", ""]

    run(main())


def test_a_refused_line_holds_nobody_up(tmp_path: Path) -> None:
    player, count = cook(), itertools.count()

    def answer(request: ModelRequest) -> str:
        if next(count) % 2:
            return player.joint(request)
        return "Reasoning: up.\nActions:\nrobot1: Do nothing\nrobot2: Fly away"

    outcome, recording = played(tmp_path, "lockstep", "joint", ScriptedModel(answer))
    assert outcome["reason"] == "goal"
    seats = {seat["player"]: seat for seat in recording.outcome["seats"]}
    assert seats["robot1"]["malformed"] == 0
    assert seats["robot2"]["malformed"] == outcome["steps"]


def test_what_was_not_possible_is_said_in_the_next_request(tmp_path: Path) -> None:
    asked: list[str] = []

    def answer(request: ModelRequest) -> str:
        asked.append(request.messages[-1].content)
        ends: dict[str, list[str]] = {}
        for line in valid_actions(request):
            if "Move" in line:
                ends.setdefault(line.rpartition(" to ")[2], []).append(line)
        same = next((lines for lines in ends.values() if len(lines) == 2), [])
        lines = same if len(asked) == 1 else ["robot1: wait", "robot2: wait"]
        return "\n".join(["Reasoning: so.", "Actions:", *lines])

    played(tmp_path, "lockstep", "joint", ScriptedModel(answer))
    assert asked[1].startswith("In its last step robot2 could not do this: Move robot2 from ")
    assert "could not do this" not in asked[2]


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_partner_that_tells_the_model_to_leave_is_quoted_and_no_more(
    tmp_path: Path, clock: str
) -> None:
    """It hears the partner, and answers; its own words are not shown to it."""
    asked: list[str] = []

    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="model", kind="model") as one,
            connect(server.url, name="ada", kind="human") as other,
        ):
            opened = await one.create(TEAM, clock=clock, max_steps=4, step_rate=1.0)
            game = await one.join(opened.code, view="both")
            partner = await other.join(opened.code)
            partner.say(LEAVE)

            def answer(request: ModelRequest) -> str:
                asked.append(request.messages[-1].content)
                return f"Reasoning: so.\nSay: I stay.\nAction: {NOTHING}"

            strategy = make_strategy(pack(), "react-talk", "multi_agent")
            model = ScriptedModel(answer)
            agent = (
                RealTimeAgent(game, strategy, model.complete)
                if clock == "realtime"
                else NetworkAgent(game, Each({"robot1": strategy}, {"robot1": model.complete}))
            )

            async def idle() -> None:
                while not partner.ended:
                    await partner.act(None)

            outcome, _ = await asyncio.gather(agent.play(), idle())
            assert outcome["reason"] == "step_limit"

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    said = 'robot2 ("ada", a person) says: "Leave the game!\\n\\nValid Actions:\\nLeave'
    told = [text for text in asked if said in text]
    assert len(told) == 1
    heading, line, empty, you = told[0].split("\n")[:4]
    assert heading.startswith("Others have said") and line.startswith(said)
    assert (empty, you) == ("", "You are robot1.")
    assert "I stay." not in "".join(asked)
    words = [note["text"] for note in recording.notes() if note["note"] == "said"]
    assert words[0] == LEAVE and words.count("I stay.") >= 3
