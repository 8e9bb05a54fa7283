"""Decisions of substitutes: equal for equal states, shared plans, bounded memory."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille.domain.loading import load_task
from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.bot_process import MoveRow
from robotouille.world.world import State, World, shared_world
from robotouille_server.rooms.substitutes import bots
from robotouille_server.rooms.substitutes.bots import Bots
from tests.support.questions import question

TASK = load_task("multi_agent/01@2")
OTHERS = [load_task(f"multi_agent/0{number}") for number in (2, 3, 4)]


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[State]:
    """Record the states from which plans are searched."""
    sought: list[State] = []
    solve = BeamPlanner.solve

    def counted(self: BeamPlanner, state: State, *arguments: Any, **options: Any) -> Any:
        sought.append(state)
        return solve(self, state, *arguments, **options)

    monkeypatch.setattr(BeamPlanner, "solve", counted)
    return sought


@pytest.mark.slow
def test_bots_in_the_same_state_share_a_plan(searches: list[State]) -> None:
    here, state = Bots(), shared_world(TASK).initial
    here.show(TASK)
    first = here.answer(TASK.digest, question(state))
    searched = len(searches)
    answers = {here.answer(TASK.digest, question(state, bot)) for bot in range(2, 101)}
    assert answers == {first}
    assert len(searches) == searched


@pytest.mark.slow
def test_world_is_learnt_once_per_seat(searches: list[State]) -> None:
    here = Bots()
    here.show(TASK)
    for player in ("robot1", "robot2", "robot1", "robot2"):
        here.learn(TASK.digest, player)
    assert len(searches) == 3, "one for each seat, and one as if robot1 made way for robot2"
    state = shared_world(TASK).initial
    here.answer(TASK.digest, question(state, 1, "robot1"))
    here.answer(TASK.digest, question(state, 2, "robot2"))
    assert len(searches) == 3, "what was learnt is not used"


def course(here: Bots, bot: int, steps: int) -> list[Any]:
    """Return the actions of one substitute while nobody else acts."""
    world, moves, done = World(TASK), (), []  # type: tuple[World, tuple[tuple[MoveRow, ...], ...], list[Any]]
    state = world.initial
    for _ in range(steps):
        if state.busy_steps("robot1"):
            state, moves = state.step([]).state, (*moves, ())
            continue
        answer = here.answer(TASK.digest, question(state, bot, observed=moves))
        done.append(answer)
        action = None if answer is None else world.action(answer[0], *answer[1:])
        result = state.step([action])
        state = result.state
        moves = (tuple(("robot1", a.action.name, a.action.arguments, a.applied)
                       for a in result.attempts),)  # fmt: skip
    return done


@pytest.mark.slow
def test_equal_questions_get_equal_answers() -> None:
    """Even if other bots have planned before, or in another process."""
    fresh, used = Bots(), Bots()
    for here in (fresh, used):
        here.show(TASK)
    for step, bot in enumerate((5, 6, 7)):
        course(used, bot, 3 * step)
    first = course(fresh, 1, 15)
    assert first == course(used, 1, 15)
    assert sum(answer is not None for answer in first) >= 5


def test_number_of_worlds_and_bots_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bots, "MAX_WORLDS", 2)
    monkeypatch.setattr(bots, "MAX_BOTS", 3)
    here = Bots()
    for number, task in enumerate(OTHERS):
        here.show(task)
        here.answer(task.digest, question(shared_world(task).initial, number + 1, kind="random"))
    assert [here.knows(task.digest) for task in OTHERS] == [False, True, True]
    state = shared_world(OTHERS[2]).initial
    for bot in range(10, 20):
        here.answer(OTHERS[2].digest, question(state, bot, kind="random"))
    assert list(here._bots) == [17, 18, 19]


def test_failed_bot_starts_over(monkeypatch: pytest.MonkeyPatch) -> None:
    here, state = Bots(), shared_world(TASK).initial
    here.show(TASK)
    answer = here.answer(TASK.digest, question(state))
    nonsense: tuple[tuple[MoveRow, ...], ...] = ((("robot1", "dance", (), True),),)
    with pytest.raises(KeyError, match="dance"):
        here.answer(TASK.digest, question(state, observed=nonsense))
    assert here.answer(TASK.digest, question(state, observed=nonsense)) == answer
