"""Asynchronous work first, waiting and idling, against hand-computed values."""

from __future__ import annotations

from robotouille import World, load_task
from robotouille.certification.step_limit import plan_beside
from robotouille_evaluation.metrics import EpisodeMeasures, Trajectory
from robotouille_evaluation.metrics.asynchrony import (
    TimeShares,
    asynchronous_first,
    needs_asynchronous_work,
    success_by_asynchronous_first,
    time_shares,
)
from tests.evaluation.metrics.courses import solo, wandering
from tests.support.episode_rows import row
from tests.world.kitchens import kitchen

LETTUCE = {"name": "lettuce", "x": 2, "y": 0, "predicates": ["iscuttable"]}
PATTY = {"name": "patty", "x": 3, "y": 0, "predicates": ["iscookable"]}
BOTH = [
    {"predicate": "iscut", "args": ["lettuce"], "ids": [1]},
    {"predicate": "iscooked", "args": ["patty"], "ids": [2]},
]
CUT = ("Move robot1 from table1 to board1", *["Make a cut in lettuce1 at board1 with robot1"] * 3)
COOK = ("Move robot1 from board1 to stove1", "Start cooking patty1 at stove1 with robot1")


def grill(cook_time: int = 3) -> World:
    """Return a world with a lettuce to cut and a patty to cook."""
    config = {"cook_time": {"default": cook_time}, "num_cuts": {"default": 3}}
    return kitchen(items=[LETTUCE, PATTY], goal=BOTH, config=config)


def planned(task: str) -> Trajectory:
    world = World(load_task(task))
    plan = plan_beside(world)
    assert plan is not None
    return Trajectory.played(world, [{a.player or "": a for a in joint} for joint in plan])


def test_tasks_that_need_asynchronous_work() -> None:
    assert needs_asynchronous_work(grill())
    assert not needs_asynchronous_work(grill(cook_time=0))
    cooked = {**PATTY, "predicates": ["iscooked"]}
    assert not needs_asynchronous_work(kitchen(items=[LETTUCE, cooked], goal=BOTH))
    for number in range(1, 11):
        assert not needs_asynchronous_work(World(load_task(f"synchronous/{number:02}")))
        assert needs_asynchronous_work(World(load_task(f"asynchronous/{number:02}")))


def test_cutting_before_cooking_is_not_asynchronous_first() -> None:
    assert asynchronous_first(solo(grill(), *CUT, *COOK)) is False


def test_cooking_before_cutting_is_asynchronous_first() -> None:
    course = solo(
        grill(),
        "Move robot1 from table1 to stove1",
        "Start cooking patty1 at stove1 with robot1",
        "Move robot1 from stove1 to board1",
        *CUT[1:],
    )
    assert asynchronous_first(course) is True


def test_filling_the_pot_is_asynchronous() -> None:
    assert asynchronous_first(planned("asynchronous/06")) is True


def test_undefined_without_asynchronous_work() -> None:
    assert asynchronous_first(wandering()) is None
    assert asynchronous_first(solo(grill(cook_time=0), *CUT, *COOK)) is None


def test_success_by_asynchronous_first() -> None:
    # Asynchronous first: one of two; not first: none of one; not defined: left out.
    failed = row().outcome.model_copy(update={"success": False})
    first, later = (
        EpisodeMeasures(asynchronous_first=True),
        EpisodeMeasures(asynchronous_first=False),
    )
    rows = [row(measures=first), row(measures=first, outcome=failed),
            row(measures=later, outcome=failed), row()]  # fmt: skip
    assert success_by_asynchronous_first(rows) == (0.5, 0.0)
    assert success_by_asynchronous_first([row()]) == (None, None)


def test_waiting_and_idle_shares() -> None:
    # 6 steps of cutting and cooking, 3 of waiting until the patty is done, 1 idle: of 10.
    course = solo(grill(), *CUT, *COOK, None, "Do nothing", None, None)
    assert course.goal_step == 9
    assert time_shares(course) == TimeShares(waiting=0.3, idle=0.1, busy=0.0)


def test_optimal_potato_soup_waits_for_the_water() -> None:
    # 19 steps, 3 of them while the water comes to the boil.
    shares = time_shares(planned("asynchronous/06"))
    assert shares == TimeShares(waiting=3 / 19, idle=0.0, busy=0.0)


def test_no_shares_without_steps() -> None:
    assert time_shares(solo(grill())) is None
