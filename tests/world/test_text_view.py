"""Messages to agents that read: player, observation, conditions of the goal."""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache

import pytest

from robotouille import State, UnknownNameError, World, load_task, task_names
from tests.support.samples import quick_sample, quick_sample_per_folder


def walk(world: World, seed: int, length: int = 40) -> list[State]:
    """Return some states of a random episode."""
    rng, states = random.Random(seed), [world.initial]
    for _ in range(length):
        joint = [rng.choice(options) for p in world.players if (options := states[-1].actions(p))]
        states.append(states[-1].step(joint).state)
    return states


def test_text_names_the_player_and_contains_the_observation() -> None:
    state = World("multi_agent/01@2").initial
    for player in ("robot1", "robot2"):
        view = state.text_view(player)
        first, rest = view.split("\n\n", 1)
        assert first == f"You are {player}."
        observation, conditions = rest.split("\n\nGoal conditions:\n")
        assert observation == state.text(player)
        assert len(conditions.splitlines()) == len(state.world.goal.terms)
    assert state.text_view().startswith(state.text() + "\n\nGoal conditions:\n- ")
    with pytest.raises(UnknownNameError):
        state.text_view("robot3")


def test_conditions_are_sentences_in_the_problems_order() -> None:
    world = World("synchronous/02")
    assert [sentence for sentence, _ in world.goal_terms(world.initial)] == [
        "bread A lies directly on some table",
        "some lettuce has been cut",
        "some lettuce is at some table",
        "bread B is at some table",
        "bread B has nothing on top of it",
    ]


WITH_GOAL = [name for name in task_names() if not name.startswith("shifts/")]


@pytest.mark.parametrize("name", quick_sample_per_folder(WITH_GOAL))
def test_all_conditions_hold_exactly_if_the_goal_does(name: str) -> None:
    world = World(load_task(name))
    for state in walk(world, seed=3):
        terms = world.goal_terms(state)
        assert len(terms) == len(world.goal.terms)
        assert all(holds for _, holds in terms) == state.goal_reached
    sentences = [sentence for sentence, _ in world.goal_terms(world.initial)]
    assert len(set(sentences)) == len(sentences)


@pytest.mark.parametrize(
    "name", quick_sample(["multi_agent/09@2", "synchronous/09", "asynchronous/10"])
)
def test_condition_holds_if_compatible_with_earlier_ones(name: str) -> None:
    """Compare with goals that have only these conditions."""
    world = World(load_task(name))

    @cache
    def part(*numbers: int) -> World:
        together = tuple(world.task.problem.goal[number] for number in numbers)
        problem = world.task.problem.model_copy(update={"goal": together})
        return World(replace(world.task, problem=problem))

    for state in walk(world, seed=5, length=6):
        held: list[int] = []
        for number, (_, holds) in enumerate(world.goal_terms(state)):
            assert part(*held, number).goal.reached(state.facts) == holds
            held += [number] if holds else []
