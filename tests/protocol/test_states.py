"""State readers follow state writers."""

from __future__ import annotations

import random
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotouille import ProtocolError, World
from robotouille.certification.certificate import load_certificate
from robotouille.domain.task import Task
from robotouille.episode import Rules, Stepped
from robotouille.errors import TooManyObjectsError
from robotouille.planning.plan import read_plan
from robotouille.protocol import states
from robotouille.protocol.states import StateReader, StateWriter, parse_label
from tests.support.games import play_through, random_choice
from tests.world.random_tasks import tasks

TASKS = ["multi_agent/10@3", "asynchronous/05", "workshop/02"]


def game(task: str, steps: int = 60) -> list[Stepped]:
    _, events = play_through(task, Rules(max_steps=steps), random_choice(3))
    return [event for event in events if isinstance(event, Stepped)]


@pytest.mark.parametrize("task", TASKS)
def test_reader_follows_a_whole_game(task: str) -> None:
    course = game(task)
    initial = course[0].before
    writer = StateWriter(initial.world)
    reader = StateReader(World(task), writer.tables(initial), writer.values(initial))
    assert reader.state.digest == initial.digest
    for step in course:
        changes = writer.changes(step.before, step.state)
        assert reader.apply(changes).digest == step.state.digest


@pytest.mark.parametrize("task", TASKS)
def test_snapshot_at_any_step_is_the_state(task: str) -> None:
    for step in game(task)[::13]:
        writer = StateWriter(step.state.world)
        reader = StateReader(World(task), writer.tables(step.state), writer.values(step.state))
        assert reader.state.digest == step.state.digest


def test_reader_reads_only_the_timers_that_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """A state may have 20,000 timers, and reading all their labels took 20 ms a step."""
    world = World("asynchronous/05")
    cooking, frying = "cook.0(patty1,stove1)", "fry.0(onion1,fryer1)"
    writer = StateWriter(world)
    values = writer.values(world.initial) | {"timers": [[cooking, [0, 1]], [frying, [0, 1]]]}
    reader = StateReader(world, writer.tables(world.initial), values)
    parsed: list[str] = []

    def parse(label: str) -> tuple[str, int, tuple[str, ...]]:
        parsed.append(label)
        return parse_label(label)

    monkeypatch.setattr(states, "parse_label", parse)
    rows = reader.apply({"timers": {cooking: [0, 2]}}).timer_rows()
    assert [(row[0], row[3]) for row in rows] == [("cook", (0, 2)), ("fry", (0, 1))]
    assert parsed == [cooking]
    assert [row[0] for row in reader.apply({"timers": {cooking: None}}).timer_rows()] == ["fry"]
    assert parsed == [cooking]


SPELLINGS = ["00", "+0", " 0", "0_0", "-0", "\N{ARABIC-INDIC DIGIT ZERO}"]


@pytest.mark.parametrize("index", SPELLINGS)
def test_an_effect_has_one_label(index: str) -> None:
    """A client kept a timer for each spelling, so a hostile server could fill its memory."""
    reader = initial_reader(World("asynchronous/05"))
    with pytest.raises(ProtocolError, match="not the number of an effect"):
        reader.apply({"timers": {f"cook.{index}(patty1,stove1)": [0, 1]}})


def test_timers_of_all_deltas_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(states, "MAX_TIMERS", 2)
    reader = initial_reader(World("asynchronous/05"))
    for item in ("patty1", "onion1"):
        reader.apply({"timers": {f"cook.0({item},stove1)": [0, 1]}})
    with pytest.raises(ProtocolError, match="more than 2 timers"):
        reader.apply({"timers": {"cook.0(onion2,stove1)": [0, 1]}})


def initial_reader(world: World) -> StateReader:
    writer = StateWriter(world)
    return StateReader(world, writer.tables(world.initial), writer.values(world.initial))


def test_unchanged_fields_are_omitted() -> None:
    state = World("synchronous/01").initial
    assert StateWriter(state.world).changes(state, state) == {}


@pytest.mark.parametrize(
    "changes",
    [
        {"add": [10**6]},
        {"busy": 3},
        {"atoms": [[0, 99]]},
        {"timers": {"nonsense": [1]}},
    ],
)
def test_changes_that_do_not_fit_are_a_mismatch(changes: dict[str, object]) -> None:
    state = World("synchronous/01").initial
    writer = StateWriter(state.world)
    reader = StateReader(state.world, writer.tables(state), writer.values(state))
    with pytest.raises(ProtocolError) as error:
        reader.apply(changes)
    assert error.value.code == "state/mismatch"


@pytest.mark.parametrize("table", ["objects", "atoms"])
def test_repeated_objects_and_atoms_do_not_extend_the_tables(table: str) -> None:
    state = World("synchronous/01").initial
    writer = StateWriter(state.world)
    tables = writer.tables(state)
    reader = StateReader(state.world, tables, writer.values(state))
    assert reader.apply({table: tables[table] * 9}) == state
    with pytest.raises(ProtocolError):
        reader.apply({"add": [len(tables["atoms"])]})


def test_unknown_objects_do_not_fill_the_memory() -> None:
    state = World("synchronous/01").initial
    writer = StateWriter(state.world)
    reader = StateReader(state.world, writer.tables(state), writer.values(state))
    with pytest.raises(ProtocolError, match="more objects than the world has"):
        reader.apply({"objects": [[f"ghost{i}", "ghost", "item"] for i in range(1000)]})


def test_objects_that_vanish_and_are_created_again_are_read() -> None:
    world = World("multi_agent/10@2")
    plan = read_plan("\n".join(load_certificate("multi_agent/10@2").plan or ()), world)
    states = {len(world.initial.objects): world.initial}
    state = world.initial
    for joint in plan:
        state = state.step(joint).state
        states.setdefault(len(state.objects), state)
    none, one, two = (states[number] for number in sorted(states)[:3])
    writer, reading = StateWriter(world), World("multi_agent/10@2")
    reader = StateReader(reading, writer.tables(none), writer.values(none))
    before = none
    for after in (one, none, one, two, none, two, one, two):
        found = reader.apply(writer.changes(before, after))
        assert set(found.fact_names()) == set(after.fact_names())
        before = after


@settings(max_examples=60, deadline=None)
@given(tasks(), st.randoms(use_true_random=False))
def test_reader_follows_jumps_between_states(task: Task, rng: random.Random) -> None:
    """A delta depends on two states only, so also one to an earlier state can be read."""
    states = [World(task).initial]
    writer = StateWriter(states[0].world)
    reader = StateReader(World(task), writer.tables(states[0]), writer.values(states[0]))
    for _ in range(12):
        before = states[-1]
        valid = [action for player in before.world.players for action in before.actions(player)]
        with suppress(TooManyObjectsError):
            after = before.step(rng.choice(valid) if valid else []).state
            states.append(rng.choice([after, after, *states]))
            found = reader.apply(writer.changes(before, states[-1]))
            assert found.digest == states[-1].digest
