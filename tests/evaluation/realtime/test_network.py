"""Slow model on a real server whose world does not wait, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from robotouille import GroundAction, World, load_task
from robotouille.planning import solve
from robotouille.replay.model_calls import model_calls
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import Game, connect
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.llm_options import LlmBotOptions
from robotouille_client.sansio.game_events import StateChanged
from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.cli.bot import LanguageModelBot
from robotouille_evaluation.metrics import Trajectory
from robotouille_evaluation.metrics.measuring import measure
from robotouille_evaluation.models import Completion, ModelRequest
from robotouille_evaluation.models.model import valid_actions
from robotouille_evaluation.packs.own import build_own_pack as pack
from robotouille_evaluation.realtime import Charge, LatePolicy
from robotouille_evaluation.realtime.network import RealTimeAgent, RealTimeOptions
from robotouille_evaluation.realtime.thoughts import Thought
from tests.support.samples import quick_sample
from tests.support.servers import serving
from tests.support.slow_policy import PATIENCE, SlowPolicy
from tests.support.virtual_time import run, virtual

ALONE, TEAM = "synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger"
PLANNER = policy_maker(BotKind.PLANNER)
Answer = Callable[[ModelRequest], str]


@cache
def best() -> tuple[str, ...]:
    found = solve(World(load_task(ALONE))).plan or ()
    return tuple(action.sentence for joint in found for action in joint)


def the_plan() -> Answer:
    coming = iter(best())
    return lambda _: f"Reasoning: so.\nAction: {next(coming)}"


def first_valid(request: ModelRequest) -> str:
    return f"Reasoning: so.\nAction: {valid_actions(request)[0]}"


def slow(seconds: float, answer: Answer) -> Callable[[ModelRequest], Awaitable[Completion]]:
    """Return a slow model."""

    async def complete(request: ModelRequest) -> Completion:
        await asyncio.sleep(seconds)
        return Completion(answer(request), seconds=seconds)

    return complete


async def joined(client: Any, code: str, **more: Any) -> Game:
    game: Game = await client.join(code, view="both", **more)
    while not game.has_state:
        await game.next_event()
    return game


def agent(game: Game, seconds: float, answer: Answer, **options: Any) -> RealTimeAgent:
    strategy = make_strategy(pack(), "react-last-reasoning-action", "synchronous")
    return RealTimeAgent(game, strategy, slow(seconds, answer), RealTimeOptions(**options))


def played(
    path: Path, seconds: float, answer: Answer, rules: dict[str, Any], **options: Any
) -> Recording:
    """Play a model alone on a server and return the recording."""

    async def main() -> None:
        async with serving(path) as server, connect(server.url, name="m") as client:
            opened = await client.create(ALONE, clock="realtime", timing="benchmark", **rules)
            game = await joined(client, opened.code)
            await agent(game, seconds, answer, **options).play()
            assert game.finished
            assert len(asyncio.all_tasks()) < 20

    run(main())
    (file,) = path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().identical
    return recording


WALL = {"step_rate": 1.0, "max_steps": 40}


def test_steps_pass_while_thinking_and_actions_have_a_basis(tmp_path: Path) -> None:
    """2.5 s at one step per second: two steps pass before the action."""
    recording = played(tmp_path, 2.5, the_plan(), WALL)
    assert recording.outcome is not None
    assert (recording.outcome["reason"], recording.outcome["steps"]) == ("goal", 24)
    course = Trajectory.recorded(recording)
    assert [(a.basis, a.step) for a in course.answers] == [(n, n + 2) for n in range(0, 24, 3)]
    measures = measure(course, 40)
    assert (measures.staleness, measures.late_answers, measures.held_share) == (2, 8, 1)
    assert measures.lost_to_thinking == 16
    assert len(list(model_calls(recording))) == 8


@pytest.mark.parametrize("late", [LatePolicy.APPLY, LatePolicy.REVALIDATE, LatePolicy.DROP])
def test_answers_overtaken_by_the_helper(tmp_path: Path, late: LatePolicy) -> None:
    received: list[str] = []

    def answer(request: ModelRequest) -> str:
        received.append(request.messages[-1].content)
        return first_valid(request)

    more = {"helper": PLANNER, "late": late, "digest_tokens": 100}
    course = Trajectory.recorded(played(tmp_path, 3.5, answer, WALL, **more))
    assert course.goal_step is not None
    refused = [answer for answer in course.answers if answer.wrong]
    dropped = [thought for thought in course.thoughts if thought.dropped]
    assert bool(refused) == (late is LatePolicy.APPLY)
    assert bool(dropped) == (late is not LatePolicy.APPLY)
    assert measure(course, 40).held_share == 0
    assert received[1].startswith("Since you last looked ")
    assert "* you: " in received[1]
    assert ("was dropped" in received[1]) == (late is not LatePolicy.APPLY)


async def deed(game: Game) -> GroundAction:
    """Wait for the next action of a player."""
    while True:
        event = await game.next_event()
        if isinstance(event, StateChanged) and event.did:
            ((_, action, applied),) = event.did
            assert applied
            return action


async def test_answer_takes_effect_while_the_helper_searches(tmp_path: Path) -> None:
    """In real time, because virtual time does not advance for threads."""
    helper = SlowPolicy()
    answers = asyncio.Queue[str]()

    async def complete(_: ModelRequest) -> Completion:
        return Completion(await answers.get())

    async with (
        asyncio.timeout(PATIENCE),
        serving(tmp_path) as server,
        connect(server.url, name="model") as one,
        connect(server.url, name="spectator") as other,
    ):
        rules = {"clock": "realtime", "step_rate": 20.0, "max_steps": 100_000}
        opened = await one.create(ALONE, timing="benchmark", **rules)
        game = await joined(one, opened.code)
        watched = await other.join(opened.code, role="spectator")
        strategy = make_strategy(pack(), "react-last-reasoning-action", "synchronous")
        options = RealTimeOptions(helper=lambda state, player: helper)
        playing = asyncio.create_task(RealTimeAgent(game, strategy, complete, options).play())
        first = await helper.asked.get()
        given_up = first.actions("robot1")[1]
        answers.put_nowait(f"Reasoning: so.\nAction: {best()[0]}")
        assert (await deed(watched)).sentence == best()[0]
        helper.answers.put(given_up)
        then = await helper.asked.get()
        assert then.facts == watched.state.facts != first.facts
        assert len([did for did in helper.observed if did]) == 1
        chosen = then.actions("robot1")[0]
        assert chosen != given_up
        helper.answers.put(chosen)
        assert await deed(watched) == chosen
        helper.answers.put(None)
        playing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await playing


DECLARED = {"step_rate": 5.0, "max_steps": 40, "thinking": "declared"}


@pytest.mark.parametrize("late", quick_sample([LatePolicy.APPLY, LatePolicy.DROP]))
def test_declared_thinking_costs_steps(tmp_path: Path, late: LatePolicy) -> None:
    """300 ms are two steps, sent with the action or passed before it."""
    contents = []
    for name, seconds in (("one", 0.0), ("other", 500.0)):
        more = {"charge": Charge.parse("declared:300"), "late": late}
        recording = played(tmp_path / name, seconds, the_plan(), DECLARED, **more)
        course = Trajectory.recorded(recording)
        assert [(a.basis, a.step) for a in course.answers if a.text] == [
            (n, n + 2) for n in range(0, 24, 3)
        ]
        measures = measure(course, 40)
        assert (measures.staleness, measures.held_share) == (2, 1)
        assert measures.lost_to_thinking == 16
        contents.append([frame.get("moves") for frame in recording.each_frame()])
    assert [[m["action"] for m in f or ()] for f in contents[0]] == [
        [m["action"] for m in f or ()] for f in contents[1]
    ]


def test_helper_acts_with_declared_thinking(tmp_path: Path) -> None:
    more = {"charge": Charge.parse("declared:86400000"), "helper": PLANNER}
    recording = played(tmp_path, 1.0, first_valid, DECLARED, **more)
    assert recording.outcome is not None
    assert (recording.outcome["reason"], recording.outcome["steps"]) == ("goal", 8)


@pytest.mark.parametrize("clock", ["turn", "realtime"])
@virtual
async def test_bot_command_with_every_clock(tmp_path: Path, clock: str) -> None:
    async with serving(tmp_path) as server, connect(server.url, name="m") as client:
        opened = await client.create(ALONE, clock=clock, step_rate=1.0, max_steps=10)
        options = LlmBotOptions(strategy="react-none", helper="planner")
        bot = LanguageModelBot.of(options, seed=3)
        async with bot.opened() as play_game:
            game = await client.join(opened.code, view=bot.view)
            outcome = await play_game(game)
        assert outcome["reason"] in ("goal", "step_limit")
    (file,) = tmp_path.glob("*.rbt")
    found = Trajectory.recorded(read_recording(file))
    assert bool(found.thoughts) == (clock == "realtime")
    assert {answer.basis for answer in found.answers} - {None}


def test_declared_thought_without_action_costs_steps(tmp_path: Path) -> None:
    """Five malformed answers of 80 ms each cost two steps."""
    more = {"charge": Charge.parse("declared:80")}
    rules = DECLARED | {"max_steps": 5}
    course = Trajectory.recorded(played(tmp_path, 1.0, lambda _: "Hm.", rules, **more))
    assert course.thoughts == (
        Thought("robot1", 0, 2),
        Thought("robot1", 2, 4),
        Thought("robot1", 4),
    )
