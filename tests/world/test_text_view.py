"""What an agent that reads is sent: who it is, the observation, every condition of the goal."""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache

import pytest

from robotouille import State, UnknownNameError, World, load_task, task_names
from robotouille.world.text import _letters
from tests.support.samples import first_of_each_folder_quickly, first_quickly


def walk(world: World, seed: int, length: int = 40) -> list[State]:
    """Some states of a random course of play."""
    rng, states = random.Random(seed), [world.initial]
    for _ in range(length):
        joint = [rng.choice(options) for p in world.players if (options := states[-1].actions(p))]
        states.append(states[-1].step(joint).state)
    return states


def test_it_says_who_one_is_and_holds_the_observation_unchanged() -> None:
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


def test_every_condition_is_said_in_words_in_the_order_of_the_problem() -> None:
    world = World("synchronous/02")
    assert [sentence for sentence, _ in world.goal_terms(world.initial)] == [
        "bread A lies directly on some table",
        "some lettuce has been cut",
        "some lettuce is at some table",
        "bread B is at some table",
        "bread B has nothing on top of it",
    ]


@pytest.mark.parametrize("name", first_of_each_folder_quickly(task_names()))
def test_all_hold_exactly_where_the_goal_is_reached(name: str) -> None:
    world = World(load_task(name))
    for state in walk(world, seed=3):
        terms = world.goal_terms(state)
        assert len(terms) == len(world.goal.terms)
        assert all(holds for _, holds in terms) == state.goal_reached
    sentences = [sentence for sentence, _ in world.goal_terms(world.initial)]
    assert len(set(sentences)) == len(sentences)


@pytest.mark.parametrize(
    "name", first_quickly(["multi_agent/09@2", "synchronous/09", "asynchronous/10"])
)
def test_one_holds_if_it_can_together_with_those_before_it(name: str) -> None:
    """Against the goals that consist of these conditions alone."""
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


def test_letters_go_on_behind_z() -> None:
    assert [_letters(number) for number in (0, 25, 26, 51, 52, 701, 702)] == [
        "A", "Z", "AA", "AZ", "BA", "ZZ", "AAA",
    ]  # fmt: skip
