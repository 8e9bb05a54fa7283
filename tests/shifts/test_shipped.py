"""The shipped shifts: bots of every number of seats serve orders in time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robotouille import World, load_task, task_names
from robotouille.certification.stars import score_limits
from robotouille.domain.schema import Arrivals
from robotouille.domain.task import Task
from robotouille.planning.policies.shift_policy import play_shift
from robotouille.planning.policies.standing import (
    is_out_of_the_way,
    seat_out_of_the_way,
    standing_at,
)
from tests.support.samples import quick_sample
from tests.support.team_games import play_team

STEPS = 90
SHIFTS = [
    (name, seats)
    for name in task_names()
    if name.startswith("shifts/")
    for seats in load_task(name).problem.seats or ()
]


def test_there_are_six_for_one_to_four_seats() -> None:
    assert len({name for name, _ in SHIFTS}) == 6
    assert {seats for _, seats in SHIFTS} == {1, 2, 3, 4}


@pytest.mark.parametrize(("name", "seats"), SHIFTS)
def test_every_player_can_begin(name: str, seats: int) -> None:
    state = World(load_task(name, seats=seats)).initial
    assert all(standing_at(state, player) for player in state.world.players)


@pytest.mark.parametrize(
    "name", ["01_sandwich_bar", "02_burger_stand", "03_one_stove", "05_clean_plates"]
)
def test_person_who_stands_still_is_in_nobodys_way(name: str) -> None:
    state = World(load_task(f"shifts/{name}", seats=2)).initial
    assert is_out_of_the_way(state, seat_out_of_the_way(state))


def begun(name: str, seats: int) -> Task:
    """Return the beginning of a shift as a shift of its own."""
    task = load_task(name, seats=seats)
    assert task.problem.shift is not None
    shift = task.problem.shift.model_copy(update={"steps": STEPS})
    return replace(task, problem=task.problem.model_copy(update={"shift": shift}))


# The counter for two players comes first: it needs hand-overs.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seats"), quick_sample(sorted(SHIFTS, key=lambda s: "counter" not in s[0]), 0, 2)
)
def test_bots_serve_most_orders(name: str, seats: int) -> None:
    outcome = play_team(begun(name, seats), limit=STEPS).outcome
    assert outcome is not None
    assert outcome.score is not None
    assert outcome.score.served >= 3
    assert outcome.score.expired <= 1


@pytest.mark.slow
def test_plan_of_a_shift_repeats_its_score() -> None:
    world = World(begun("shifts/01_sandwich_bar", 1))
    plan, last = play_shift(world)
    state = world.initial
    for joint in plan:
        step = state.step(joint)
        assert all(attempt.applied for attempt in step.attempts)
        state = step.state
    assert state == last
    assert world.shift is not None and last.orders is not None
    assert 0 < last.orders.score <= world.shift.bound


@pytest.mark.parametrize("name", sorted({name for name, _ in SHIFTS}))
def test_bound_of_a_shift_counts_every_order_with_nearly_the_whole_tip(name: str) -> None:
    world = World(load_task(name, timing="people", seed=5))
    shift = world.task.problem.shift
    assert shift is not None and world.shift is not None
    assert not isinstance(shift.arrivals, Arrivals)
    expected = 0
    for arrival in shift.arrivals:
        if arrival.at < shift.steps:
            dish = shift.menu[arrival.dish]
            steps = 5 * dish.patience
            expected += dish.points + dish.tip * (steps - 1) // steps
    assert world.shift.bound == expected


@pytest.mark.parametrize(("name", "seats"), SHIFTS)
def test_every_team_can_earn_stars(name: str, seats: int) -> None:
    task = load_task(name, seats=seats)
    world = World(task)
    limits = score_limits(task.problem, seats)
    assert limits is not None and world.shift is not None
    assert 0 < limits.one < limits.two < limits.three < world.shift.bound
