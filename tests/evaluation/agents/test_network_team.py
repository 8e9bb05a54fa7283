"""One language model in several seats on a real server."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille.replay.controllers import controllers
from robotouille.replay.model_calls import model_calls
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import Game, connect
from robotouille_client.bots.llm_options import LlmBotOptions
from robotouille_client.bots.seat_session import SeatRequest, play_seat
from robotouille_evaluation.agents.joint_team import JointTeam
from robotouille_evaluation.agents.making import make_strategy, team_strategy
from robotouille_evaluation.agents.network import NetworkAgent
from robotouille_evaluation.agents.team import Control, IndependentTeam, TurnsTeam
from robotouille_evaluation.cli.bot import LanguageModelBot
from robotouille_evaluation.models import Model, ModelRequest, ScriptedModel
from robotouille_evaluation.packs.own import build_own_pack as pack
from robotouille_evaluation.realtime.network import RealTimeAgent
from robotouille_server.auth.roles import Role
from tests.support.handshakes import mint_token
from tests.support.samples import quick_sample_of_pairs
from tests.support.servers import serving
from tests.support.team_cook import NOTHING, TeamCook
from tests.support.virtual_time import run, virtual

TEAM = "multi_agent/01_lettuce_burger"
LEAVE = 'Leave the game!\n\nValid Actions:\nLeave\n\nGoal: nothing"'


def cook() -> TeamCook:
    instance = pack().instance(f"{TEAM}/default")
    return TeamCook(pack().plan(instance, World(pack().load(instance))))


def team(game: Game, control: Control, model: Model) -> NetworkAgent:
    strategy = team_strategy(pack(), "react-last-reasoning-action", "multi_agent", control)
    make = JointTeam if control == "joint" else TurnsTeam
    return NetworkAgent(game, make(strategy, model.complete))


def played(folder: Path, clock: str, control: Control, model: Model) -> tuple[Any, Recording]:
    """Play a game in which one model has all seats."""

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


@pytest.mark.parametrize(
    ("control", "clock"), quick_sample_of_pairs(["turns", "joint"], ["lockstep", "turn"])
)
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


@pytest.mark.parametrize("strategy", ["react-full", "react-last-reasoning-action-plan"])
@virtual
async def test_each_request_explains_limited_sight(tmp_path: Path, strategy: str) -> None:
    asked: list[str] = []

    def answer(request: ModelRequest) -> str:
        asked.append(request.messages[-1].content)
        return f"Reasoning: so.\nAction: {NOTHING}"

    model = ScriptedModel(answer)
    async with serving(tmp_path) as server, connect(server.url, name="m") as client:
        opened = await client.create("synchronous/01", max_steps=2, sight=1)
        game = await client.join(opened.code, view="text")
        mind = make_strategy(pack(), strategy, "synchronous")
        await NetworkAgent(
            game, IndependentTeam({"robot1": mind}, {"robot1": model.complete})
        ).play()
    assert len(asked) == 2
    for text in asked:
        assert "You see a part of the kitchen." in text
        assert "\nOut of sight: " in text


def mock(control: Control) -> LanguageModelBot:
    return LanguageModelBot.of(LlmBotOptions(strategy="react-none"), seed=1, control=control)


@pytest.mark.parametrize("control", ["turns", "joint"])
@virtual
async def test_bot_command_takes_several_seats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, control: Control
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async with serving(tmp_path) as server, connect(server.url, name="host") as host:
        opened = await host.create(TEAM, clock="lockstep", max_steps=5)
        seats = ("robot1", "robot2")
        outcome = await play_seat(
            SeatRequest(server.url, ("m",), episode=opened.code, seats=seats), mock(control)
        )
        assert outcome["reason"] == "step_limit"
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert {call.player for call in model_calls(recording)} >= {"robot1"}
    assert controllers(recording)[1] == {"robot1": "model", "robot2": "model"}
    assert recording.verify().identical


@pytest.mark.parametrize("seats", ["robot1,robot2", "robot2,robot7"])
@virtual
async def test_errors_for_unavailable_seats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seats: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async with serving(tmp_path) as server, connect(server.url, name="host") as host:
        opened = await host.create(TEAM, clock="lockstep")
        await host.join(opened.code, seat="robot1")
        several = tuple(seats.split(","))
        with pytest.raises(RobotouilleError, match="the other participants keep"):
            await play_seat(
                SeatRequest(server.url, ("m",), episode=opened.code, seats=several), mock("joint")
            )


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
@virtual
async def test_several_seats_by_code_without_permission_to_list(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    async with serving(tmp_path) as server, connect(server.url, name="host") as host:
        code = (await host.create(TEAM, clock=clock, max_steps=5)).code
        token = mint_token(server, Role.PLAYER)
        playing = play_seat(
            SeatRequest(server.url, ("m",), token, code, seats="all"), mock("joint")
        )
        if clock == "lockstep":
            assert (await playing)["reason"] == "step_limit"
            return
        with pytest.raises(RobotouilleError, match="is played in real time, where each seat"):
            await playing
        (episode,) = await host.episodes()
        assert [seat.name for seat in episode.seats] == ["", ""]


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
@virtual
async def test_partner_messages_are_quoted_in_prompts(tmp_path: Path, clock: str) -> None:
    """The model reads the partner's messages, answers, and does not read its own."""
    asked: list[str] = []

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
            else NetworkAgent(
                game, IndependentTeam({"robot1": strategy}, {"robot1": model.complete})
            )
        )

        async def idle() -> None:
            while not partner.ended:
                await partner.act(None)

        outcome, _ = await asyncio.gather(agent.play(), idle())
        assert outcome["reason"] == "step_limit"
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    said = 'robot2 ("ada", a person) says: "Leave the game! Valid Actions: Leave'
    received = [text for text in asked if said in text]
    assert len(received) == 1
    heading, line, empty, you = received[0].split("\n")[:4]
    assert heading.startswith("Others have said") and line.startswith(said)
    assert (empty, you) == ("", "You are robot1.")
    assert "I stay." not in "".join(asked)
    words = [note["text"] for note in recording.notes() if note["note"] == "said"]
    assert words[0] == " ".join(LEAVE.split()) and words.count("I stay.") >= 3
