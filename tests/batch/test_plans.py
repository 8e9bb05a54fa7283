"""In shipped plans, the goal holds in a batch exactly if it holds in the world.

Plans order the actions of a step themselves; batches use the order of seats.
"""

from __future__ import annotations

import numpy as np
import pytest

from robotouille import World, load_task
from robotouille.batch import BatchWorld
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from tests.batch.agreement import agree
from tests.support.samples import quick_sample

PLANS = sorted(
    str(path.relative_to(data_folder("problems")).with_suffix(""))
    for folder in ("synchronous", "asynchronous", "multi_agent")
    for path in (data_folder("problems") / folder).glob("*.plan")
    if "@3" not in path.name and "@4" not in path.name
)


@pytest.mark.parametrize("name", quick_sample(PLANS))
def test_plans_reach_the_goal(name: str) -> None:
    world = World(load_task(name))
    batch = BatchWorld(world, 3)
    state, states = world.initial, []
    plan = (data_folder("problems") / f"{name}.plan").read_text(encoding="utf-8")
    for joint in [*read_plan(plan, world), ()]:
        in_seats = {
            player: action
            for player in world.players
            for action in joint
            if action.player in (player, None)
        }
        batch.set_state(0, state)
        numbers = np.full((3, len(world.players)), -1)
        for player, action in in_seats.items():
            seat = world.players.index(player)
            numbers[0, seat] = world.encoding.number(state.facts, player, action)
        result, expected = batch.step(numbers), state.step(in_seats)
        assert result.terminated[0] == expected.goal_reached
        assert np.array_equal(batch.vectors()[0], expected.state.vector())
        state = state.step(list(joint)).state
        states.append(state)
    assert result.terminated[0]
    agree(batch, world, 3, 10, seed=1, states=states[-3:])
