"""Delays, repetitions and conditions: what the numbers of a problem's config mean."""

import pytest

from robotouille import State, World
from tests.world.kitchens import act, kitchen, play, waiting

PATTY = {"name": "patty", "x": 3, "y": 0, "predicates": ["iscookable"]}
LETTUCE = {"name": "lettuce", "x": 2, "y": 0, "predicates": ["iscuttable"]}
COOK = [{"name": "robot", "x": 3, "y": 1, "direction": [0, -1]}]
CHEF = [{"name": "robot", "x": 2, "y": 1, "direction": [0, -1]}]


def cooking(world: World) -> State:
    return act(world.initial, "cook", "robot1", "patty1", "stove1")


def steps_until(state: State, predicate: str, *arguments: str) -> int:
    """Return the number of steps without actions after which a fact holds."""
    for step in range(50):
        if state.holds(predicate, *arguments):
            return step
        state = waiting(state, 1)
    pytest.fail(f"{predicate} never became true")


@pytest.mark.parametrize(
    ("config", "steps"),
    [
        ({}, 3),
        ({"default": 3}, 3),
        ({"default": 0}, 0),
        ({"default": 1}, 1),
        ({"default": 7, "patty": 2}, 2),
        ({"default": 7, "patty": 2, "patty1": 5}, 5),
        ({"lettuce": 9}, 3),
    ],
)
def test_delay_counts_the_steps_after_its_action(config: dict[str, int], steps: int) -> None:
    world = kitchen(items=[PATTY], players=COOK, config={"cook_time": config})
    state = cooking(world)
    assert steps_until(state, "iscooked", "patty1") == steps
    done = waiting(state, steps)
    assert not done.holds("iscooking", "patty1")
    assert not done.timers
    assert waiting(done, 5) == done


def test_paused_delay_keeps_its_count() -> None:
    world = kitchen(items=[PATTY], players=COOK)
    state = waiting(cooking(world), 1)
    assert [(p.done, p.total, p.running) for p in state.progress()] == [(2, 4, True)]
    state = act(state, "pick-up-item", "robot1", "patty1", "stove1")
    assert not state.holds("iscooking", "patty1")
    assert [(p.done, p.total, p.running) for p in state.progress()] == [(2, 4, False)]
    state = waiting(state, 10)
    assert not state.holds("iscooked", "patty1")
    place = world.parse(state, "robot1", "Put down patty1 at stove1 with robot1")
    state = state.step(place).state
    assert state.holds("iscooking", "patty1")
    assert steps_until(state, "iscooked", "patty1") == 1


def test_restarting_on_the_same_stove_changes_nothing() -> None:
    """The effect is already active, and only time advances a delay."""
    fry = {**PATTY, "name": "potato", "predicates": ["isfryable"]}
    stations = [{"name": "fryer", "x": 3, "y": 0}, {"name": "table", "x": 0, "y": 0}]
    state = kitchen(items=[fry], players=COOK, stations=stations).initial
    for _ in range(3):
        state = act(state, "fry", "robot1", "potato1", "fryer1")
    assert len(state.timers.entries) == 1
    assert steps_until(state, "isfried", "potato1") == 1


def test_negation_is_asserted_once() -> None:
    """An ended effect must not negate a result of another effect."""
    world = kitchen(items=[PATTY], players=COOK)
    state = play(
        cooking(world),
        "Pick up patty1 at stove1 with robot1",
        "Move robot1 from stove1 to stove2",
        "Put down patty1 at stove2 with robot1",
        "Start cooking patty1 at stove2 with robot1",
    )
    assert len(state.timers.entries) == 2
    for _ in range(3):
        assert state.holds("iscooking", "patty1")
        state = waiting(state, 1)
    assert state.holds("iscooked", "patty1")


@pytest.mark.parametrize(
    ("config", "cuts"),
    [({}, 3), ({"default": 1}, 1), ({"default": 0}, 1), ({"default": 2, "lettuce": 5}, 5)],
)
def test_item_is_cut_after_the_configured_number_of_cuts(config: dict[str, int], cuts: int) -> None:
    state = kitchen(items=[LETTUCE], players=CHEF, config={"num_cuts": config}).initial
    for number in range(cuts):
        assert not state.holds("iscut", "lettuce1"), number
        state = act(state, "cut", "robot1", "lettuce1", "board1")
    assert state.holds("iscut", "lettuce1")


def test_progress_names_active_effects() -> None:
    world = kitchen(items=[PATTY], players=COOK, config={"cook_time": {"patty": 5}})
    (progress,) = cooking(world).progress()
    assert progress.action == "cook"
    assert progress.arguments == ("patty1", "stove1")
    assert progress.subject == "patty1"
    assert (progress.done, progress.total, progress.running) == (1, 6, True)
