"""Opportunities: which players could act usefully, judged by the state alone."""

from __future__ import annotations

from collections.abc import Iterator

from robotouille import World, load_task
from robotouille.domain.task import Task
from robotouille.installation import data_folder
from robotouille.planning.beam.opportunities import Opportunities
from robotouille.planning.plan import read_plan
from robotouille.world.world import State

PROBLEMS = data_folder("problems")


def after_plan(world: World, task: str, count: int) -> Iterator[State]:
    """Yield the states before the first actions of the shipped plan of a task, and after them."""
    state = world.initial
    yield state
    plan = read_plan((PROBLEMS / f"{task}.plan").read_text(), World(task), task)
    for joint in [*plan][:count]:
        actions = [world.action(a.name, *a.arguments) for a in joint if a is not None]
        state = state.step(actions).state
        yield state


def test_player_with_work_left_could_act_usefully_until_the_goal() -> None:
    world = World("training/01_synchronous")
    judge = Opportunities(world)
    *before, last = after_plan(world, "training/01_synchronous", 1000)
    assert all(judge.useful(state, "robot1") for state in before)
    assert last.goal_reached
    assert not judge.useful(last, "robot1")


def test_player_cannot_act_usefully_while_the_last_thing_cooks() -> None:
    task = load_task("training/02_asynchronous")
    problem = {**task.json["problem"], "config": {"cook_time": {"default": 200}}}
    world = World(Task.from_json({**task.json, "problem": problem}, "slow"))
    judge = Opportunities(world)
    *_, cooking = after_plan(world, "training/02_asynchronous", 15)
    assert judge.useful(cooking, "robot1")  # The top bun can be fetched.
    for sentence in ("move(robot1, table6, table5)", "pick-up-item(robot1, topbun1, table5)"):
        cooking = cooking.step(world.parse(cooking, "robot1", sentence)).state
    assert not judge.useful(cooking, "robot1")
