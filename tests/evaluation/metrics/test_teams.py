"""Contribution, blocking and overlap, against hand-computed values."""

from __future__ import annotations

from robotouille import World, load_task
from robotouille.certification.step_limit import plan_beside
from robotouille_evaluation.metrics import Trajectory
from robotouille_evaluation.metrics.asynchrony import TimeShares, time_shares
from robotouille_evaluation.metrics.measuring import blocking, contributions, overlap
from robotouille_evaluation.metrics.trajectory import rejected_answer
from tests.evaluation.metrics.courses import wandering

TWO = World(load_task("multi_agent/01"))


def planned() -> Trajectory:
    """Return the trajectory of the shipped plan for two players, with 14 steps."""
    plan = plan_beside(TWO)
    assert plan is not None
    return Trajectory.played(TWO, [{a.player or "": a for a in joint} for joint in plan])


def test_contributions() -> None:
    # robot1 takes the patty, lays it down, cooks it, takes it, stacks it: 5. robot2 takes the
    # lettuce, lays it down, cuts it three times, takes it, stacks it, takes the bun, stacks it: 9.
    assert contributions(planned()) == {"robot1": 5 / 14, "robot2": 9 / 14}


def test_walking_is_not_a_contribution() -> None:
    course = Trajectory.played(TWO, [{"robot1": "Move robot1 from table2 to table4"}])
    assert contributions(course) == {"robot1": 0.0, "robot2": 0.0}


def test_overlap() -> None:
    # In 14 steps both act, but in steps 6, 7, 8 and 10: 10 of 14.
    assert overlap(planned()) == 10 / 14
    assert overlap(wandering()) is None


def test_shares_of_time() -> None:
    # robot1 stands by in 6, 7 and 8 while the patty cooks, and idles in 10: of 28 player's steps.
    assert time_shares(planned()) == TimeShares(waiting=3 / 28, idle=1 / 28, busy=0.0)


def test_two_players_at_one_station() -> None:
    joint = {"robot1": "Move robot1 from table2 to table4",
             "robot2": "Move robot2 from table1 to table4"}  # fmt: skip
    course = Trajectory.played(TWO, [joint])
    assert [move.applied for move in course.moves[0]] == [True, False]
    assert blocking(course) == 1


def test_occupied_station() -> None:
    empty = Trajectory.played(TWO, [])
    taken = rejected_answer(0, "robot1", "Move robot1 from table2 to table1", TWO.initial)
    assert [unmet.predicate for unmet in taken.unmet] == ["vacant"]
    far = rejected_answer(0, "robot1", "Move robot1 from table5 to table1", TWO.initial)
    course = Trajectory(TWO, empty.states, empty.moves, (taken, far))
    # The second is wrong about its own place as well: that is not the partner's doing.
    assert blocking(course) == 1
    assert blocking(planned()) == 0
