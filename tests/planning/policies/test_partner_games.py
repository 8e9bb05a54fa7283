"""Measures of games with simulated people: which bots stand still, and which games are slow."""

from __future__ import annotations

import pytest

from robotouille import State, load_task
from robotouille.planning.policies.aside import with_others_aside
from robotouille.planning.policies.deferral import after_possible
from robotouille.planning.policies.policy import Did
from robotouille.planning.policies.standing import seat_out_of_the_way
from tests.programs.bot_work import CAREFUL, STANDSTILL, Kitchen, standstills
from tests.programs.partner_games import Setting, planned_length, play
from tests.support.samples import quick_sample
from tests.support.team_games import TeamGame

CUT_OFF = [("02", 2), ("02", 3), ("10", 2), ("10", 3), ("10", 4)]
"""Tasks and seats in which a person who does nothing stands at a place that the bots need."""


def kitchen_of(task: str, seats: int) -> Kitchen:
    return Kitchen(load_task(f"multi_agent/{task}", seats=seats, timing="people"))


def walking_to_and_fro(state: State, player: str, steps: int) -> list[Did]:
    did: list[Did] = []
    for _ in range(steps):
        walks = [action for action in state.actions(player) if action.destination]
        did.append([(player, action, True) for action in walks[:1]])
        state = state.step(walks[:1]).state
    return did


@pytest.mark.slow
def test_bot_that_stands_while_others_act_is_counted() -> None:
    kitchen = kitchen_of("01", 2)
    busy, idle = kitchen.world.players
    game = TeamGame(steps=walking_to_and_fro(kitchen.world.initial, busy, 2 * STANDSTILL))
    (still,) = standstills(kitchen, [busy, idle], game)
    assert still[:3] == (idle, 0, 2 * STANDSTILL)
    assert still.work


def test_short_rest_is_no_standstill() -> None:
    kitchen = kitchen_of("01", 2)
    game = TeamGame(steps=[[]] * (STANDSTILL - 1))
    assert standstills(kitchen, kitchen.world.players, game) == []


@pytest.mark.slow
def test_work_counts_only_while_it_needs_nobody_to_step_aside() -> None:
    # The other robot stands at the only stove.
    kitchen = kitchen_of("02", 2)
    planned = kitchen.plan(with_others_aside(kitchen.world.initial, ["robot1"]), ("robot2",))
    assert planned is not None
    plan, aside = planned
    here = kitchen.anytime.in_model(kitchen.world.initial)
    assert kitchen.work(here, "robot2") == "work"
    done = after_possible(plan, aside, here, ["robot2"])
    assert not kitchen.work(done, "robot2")
    assert kitchen.work(with_others_aside(done, ["robot1"]), "robot2") == "goal"


@pytest.mark.slow
@pytest.mark.parametrize(("task", "seats"), quick_sample(CUT_OFF, nightly=2))
def test_kitchen_cut_off_by_a_person_has_no_plan(task: str, seats: int) -> None:
    kitchen = kitchen_of(task, seats)
    world = kitchen.world
    bots = tuple(p for p in world.players if p != seat_out_of_the_way(world.initial))
    assert kitchen.plan(world.initial, bots) is None
    *_, found = kitchen.anytime.search(world.initial, team=bots, beam=CAREFUL, choices=6)
    assert found.plan is None
    # The person has only to step aside.
    assert planned_length(f"multi_agent/{task}", seats, bots, "partner", 0) > 0


STOOD = [
    ("07", 3, "blocking", 2),
    ("08", 3, "wandering", 0),
    ("07", 3, "blocking", 0),
    ("07", 4, "blocking", 0),
    ("02", 4, "hoarding", 0),
    ("10", 4, "idle", 0),
    ("02", 3, "wandering", 6),
    ("09", 3, "blocking", 4),
    ("09", 3, "hoarding", 2),
]
"""Games in which bots once stood for ten seconds or more although they had useful work."""


@pytest.mark.slow
@pytest.mark.parametrize(("task", "seats", "who", "seed"), quick_sample(STOOD, 2, nightly=4))
def test_bots_with_work_do_not_stand_still(task: str, seats: int, who: str, seed: int) -> None:
    report = play(Setting(f"multi_agent/{task}", seats, who, "partner", seed=seed))
    assert not report.fault, report
