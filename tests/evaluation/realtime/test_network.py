"""A slow model on a real server whose world does not wait, in virtual time."""

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
from robotouille_client.bots import play
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.sansio.game_events import Changed
from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.cli.bot import LanguageModelBot
from robotouille_evaluation.metrics import Trajectory
from robotouille_evaluation.metrics.measuring import measure
from robotouille_evaluation.models import Completion, ModelRequest
from robotouille_evaluation.models.valid_actions import valid_actions
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.realtime import Charge, Late
from robotouille_evaluation.realtime.network import RealTimeAgent, RealTimeOptions
from robotouille_evaluation.realtime.thoughts import Thought
from tests.support.pondering import PATIENCE, Pondering
from tests.support.servers import serving
from tests.support.virtual_time import run

ALONE, TEAM = "synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger"
PLANNER = policy_maker(BotKind.PLANNER)
FOR_EVER = 1e9
Answer = Callable[[ModelRequest], str]


@cache
def pack() -> Pack:
    return build_own_pack()


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
    """A model that takes its time."""

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
    """A model alone on a server; what was recorded of it."""

    async def main() -> None:
        async with serving(path) as server, connect(server.url, name="m") as client:
            opened = await client.create(ALONE, clock="realtime", timing="benchmark", **rules)
            game = await joined(client, opened.code)
            await agent(game, seconds, answer, **options).play()
            assert game.over
            assert len(asyncio.all_tasks()) < 20

    run(main())
    (file,) = path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().identical
    return recording


WALL = {"step_rate": 1.0, "max_steps": 40}


def test_steps_go_by_while_it_thinks_and_actions_say_what_they_are_based_on(
    tmp_path: Path,
) -> None:
    """2.5 s at a step a second: two steps pass between a look and the one that takes the action."""
    recording = played(tmp_path, 2.5, the_plan(), WALL)
    assert recording.outcome is not None
    assert (recording.outcome["reason"], recording.outcome["steps"]) == ("goal", 24)
    course = Trajectory.recorded(recording)
    assert [(a.basis, a.step) for a in course.answers] == [(n, n + 2) for n in range(0, 24, 3)]
    measures = measure(course, 40)
    assert (measures.staleness, measures.late_answers, measures.held_share) == (2, 8, 1)
    assert measures.lost_to_thinking == 16
    assert len(list(model_calls(recording))) == 8


def test_a_model_that_never_answers_is_given_up_and_its_helper_wins(tmp_path: Path) -> None:
    recording = played(tmp_path, FOR_EVER, first_valid, WALL, helper=PLANNER)
    assert recording.outcome is not None
    assert recording.outcome["reason"] == "goal"
    course = Trajectory.recorded(recording)
    assert course.thoughts == (Thought("robot1", 0),)
    assert {answer.basis for answer in course.answers} == {None}
    assert measure(course, 40).lost_to_thinking == 0


def test_without_a_helper_the_world_goes_on_to_its_last_step(tmp_path: Path) -> None:
    recording = played(tmp_path, FOR_EVER, first_valid, {"step_rate": 1.0, "max_steps": 7})
    course = Trajectory.recorded(recording)
    assert (course.steps, measure(course, 7).lost_to_thinking) == (7, 7)


@pytest.mark.parametrize("late", [Late.APPLY, Late.REVALIDATE, Late.DROP])
def test_what_becomes_of_answers_that_the_helper_has_overtaken(tmp_path: Path, late: Late) -> None:
    told: list[str] = []

    def answer(request: ModelRequest) -> str:
        told.append(request.messages[-1].content)
        return first_valid(request)

    more = {"helper": PLANNER, "late": late, "digest_tokens": 100}
    course = Trajectory.recorded(played(tmp_path, 3.5, answer, WALL, **more))
    assert course.goal_step is not None
    refused = [answer for answer in course.answers if answer.wrong]
    dropped = [thought for thought in course.thoughts if thought.dropped]
    assert bool(refused) == (late is Late.APPLY)
    assert bool(dropped) == (late is not Late.APPLY)
    assert measure(course, 40).held_share == 0
    assert told[1].startswith("Since you last looked ")
    assert "* you: " in told[1]
    assert ("was dropped" in told[1]) == (late is not Late.APPLY)


async def deed(game: Game) -> GroundAction:
    """The next thing that somebody does."""
    while True:
        event = await game.next_event()
        if isinstance(event, Changed) and event.did:
            ((_, action, applied),) = event.did
            assert applied
            return action


async def test_an_answer_is_acted_on_while_its_helper_still_searches(tmp_path: Path) -> None:
    """In real time: where time is virtual, it stands still for threads."""
    helper = Pondering()
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


@pytest.mark.parametrize("late", [Late.APPLY, Late.DROP])
def test_declared_thinking_costs_steps_however_long_it_takes(tmp_path: Path, late: Late) -> None:
    """300 ms are two steps: sent with the action, or passed before it."""
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


def test_a_helper_acts_where_thinking_is_declared(tmp_path: Path) -> None:
    more = {"charge": Charge.parse("declared:86400000"), "helper": PLANNER}
    recording = played(tmp_path, 1.0, first_valid, DECLARED, **more)
    assert recording.outcome is not None
    assert (recording.outcome["reason"], recording.outcome["steps"]) == ("goal", 8)


def test_a_slow_model_and_a_planner_play_together(tmp_path: Path) -> None:
    """Who did what, and how stale it was, is in the recording."""

    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="model") as one,
            connect(server.url, name="planner") as other,
        ):
            opened = await one.create(
                TEAM, clock="realtime", step_rate=1.0, timing="benchmark", max_steps=60
            )
            game, partner = await asyncio.gather(joined(one, opened.code), other.join(opened.code))
            slow_one = agent(game, 3.3, first_valid, helper=PLANNER, late=Late.REVALIDATE)
            playing = play(partner, PLANNER, threaded=False)
            outcome, _ = await asyncio.gather(slow_one.play(), playing)
            assert outcome["reason"] == "goal"

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().identical
    course = Trajectory.recorded(recording)
    assert course.thoughts
    assert all(thought.seat == "robot1" for thought in course.thoughts)


@pytest.mark.parametrize("clock", ["turn", "realtime"])
def test_the_bot_of_the_command_line_plays_with_every_clock(tmp_path: Path, clock: str) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="m") as client:
            opened = await client.create(ALONE, clock=clock, step_rate=1.0, max_steps=10)
            bot = LanguageModelBot.of(
                "mock",
                base_url="",
                strategy="react-none",
                transcript=None,
                seed=3,
                temperature=None,
                prices="",
                timeout=None,
                attempts=None,
                helper="planner",
            )
            async with bot.opened() as play_game:
                game = await client.join(opened.code, view=bot.view)
                outcome = await play_game(game)
            assert outcome["reason"] in ("goal", "step_limit")

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    found = Trajectory.recorded(read_recording(file))
    assert bool(found.thoughts) == (clock == "realtime")
    assert {answer.basis for answer in found.answers} - {None}


def test_an_answer_for_a_finished_game_is_not_waited_for(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            connect(server.url, name="model") as one,
            connect(server.url, name="other") as other,
        ):
            opened = await one.create(TEAM, clock="realtime", step_rate=1.0, absence="end")
            game, partner = await asyncio.gather(joined(one, opened.code), other.join(opened.code))
            playing = asyncio.create_task(agent(game, FOR_EVER, first_valid).play())
            while game.step < 2:
                await asyncio.sleep(0.5)
            await other.leave()
            outcome = await playing
            assert outcome["reason"] == "abandoned"
            assert partner.ended

    run(main())


def test_a_declared_thought_without_an_action_costs_its_steps_too(tmp_path: Path) -> None:
    """Five answers that are none, for 80 ms each, are two steps."""
    more = {"charge": Charge.parse("declared:80")}
    rules = DECLARED | {"max_steps": 5}
    course = Trajectory.recorded(played(tmp_path, 1.0, lambda _: "Hm.", rules, **more))
    assert course.thoughts == (
        Thought("robot1", 0, 2),
        Thought("robot1", 2, 4),
        Thought("robot1", 4),
    )
