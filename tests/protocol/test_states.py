"""States as messages carry them: a reader that is told every change has the writer's state."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError, World
from robotouille.episode import Rules, Stepped
from robotouille.protocol.states import StateReader, StateWriter, effect_label, parse_label
from tests.support.games import play_through, random_choice

TASKS = ["multi_agent/10@3", "asynchronous/05", "workshop/02"]


def game(task: str, steps: int = 60) -> list[Stepped]:
    _, events = play_through(task, Rules(max_steps=steps), random_choice(3))
    return [event for event in events if isinstance(event, Stepped)]


@pytest.mark.parametrize("task", TASKS)
def test_a_reader_follows_a_whole_game(task: str) -> None:
    course = game(task)
    initial = course[0].before
    writer = StateWriter(initial.world)
    reader = StateReader(World(task), writer.tables(initial), writer.values(initial))
    assert reader.state.digest == initial.digest
    for step in course:
        changes = writer.changes(step.before, step.state)
        assert reader.apply(changes).digest == step.state.digest


@pytest.mark.parametrize("task", TASKS)
def test_a_picture_at_any_step_is_the_state(task: str) -> None:
    for step in game(task)[::13]:
        writer = StateWriter(step.state.world)
        reader = StateReader(World(task), writer.tables(step.state), writer.values(step.state))
        assert reader.state.digest == step.state.digest


def test_what_did_not_change_is_not_told() -> None:
    state = World("synchronous/01").initial
    assert StateWriter(state.world).changes(state, state) == {}


def test_what_is_asked_for_twice_is_made_once() -> None:
    step = game("multi_agent/10@3", 5)[0]
    writer = StateWriter(step.state.world)
    again = writer.changes(step.before, step.state)
    assert writer.changes(step.before, step.state) is again
    assert writer.tables(step.state) is writer.tables(step.state)


def test_labels_of_effects_come_back() -> None:
    effects = [e for step in game("workshop/01", 130) for e, _ in step.state.timers.entries]
    assert effects
    for effect in effects:
        assert parse_label(effect_label(effect)) == effect.label
    for wrong in ("cook", "cook.0", "cook(patty1)", "cook.x(patty1)"):
        with pytest.raises(ValueError, match=r"effect|invalid literal"):
            parse_label(wrong)


@pytest.mark.parametrize(
    "changes",
    [
        {"add": [10**6]},
        {"busy": 3},
        {"atoms": [[0, 99]]},
        {"timers": {"nonsense": [1]}},
    ],
)
def test_what_fits_no_world_is_a_mismatch(changes: dict[str, object]) -> None:
    state = World("synchronous/01").initial
    writer = StateWriter(state.world)
    reader = StateReader(state.world, writer.tables(state), writer.values(state))
    with pytest.raises(ProtocolError) as error:
        reader.apply(changes)
    assert error.value.code == "state/mismatch"
