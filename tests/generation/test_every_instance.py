"""Properties of every instance for any task, seed and parameters."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import World
from robotouille.generation import AttemptError, Generator, Instance, Kind, Parameters
from robotouille.planning.plan import replay
from robotouille.world.lint import lint_task
from tests.generation.kitchens import TASKS, generator, seats_of, shipped_plan
from tests.support.thorough import thorough

PARAMETERS = [
    Parameters(),
    Parameters(stations=0, items=0),
    Parameters(stations=7, items=5),
    Parameters(width=11, height=9),
    Parameters(stacking=True, stations=3),
    Parameters(stacking=False, items=1),
]
QUICK = thorough(15)
FEW = thorough(5)

seeds = st.integers(0, 10**6)
free = st.builds(
    generator,
    st.sampled_from(TASKS),
    st.just(Kind.FREE),
    st.sampled_from([*PARAMETERS, Parameters(held=True)]),
)
noisy = st.builds(
    generator, st.sampled_from(TASKS), st.just(Kind.NOISY), st.sampled_from(PARAMETERS)
)
generators = free | noisy


def draw(source: Generator, seed: int) -> Instance:
    """Return the first attempt in which the objects fit."""
    for attempt in range(1, 50):
        try:
            return source.draw(seed, attempt)
        except AttemptError:
            pass
    raise AssertionError("nothing fits")


@FEW
@given(generators, seeds)
def test_file_contains_its_origin(source: Generator, seed: int) -> None:
    instance = draw(source, seed)
    received = instance.task.problem.provenance
    assert received is not None
    again = Generator(source.task, Kind(received.kind), Parameters(**received.parameters))
    assert again.draw(received.seed, received.attempt).text == instance.text
    assert (received.source, received.seed, received.kind) == (source.task.name, seed, source.kind)


@QUICK
@given(generators, seeds)
def test_all_stations_are_reachable(source: Generator, seed: int) -> None:
    instance = draw(source, seed)
    problem = instance.task.problem
    players = [o for t in source.task.domain.player_types for o in problem.objects[t]]
    stations = [o for t in source.task.domain.station_types for o in problem.objects[t]]
    blocked = {(o.x, o.y) for o in stations}
    grid = {(x, y) for x in range(problem.width) for y in range(problem.height)}
    free_tiles = grid - blocked
    assert len(blocked) == len(stations)
    assert reached(min(free_tiles), free_tiles) == free_tiles
    assert all(neighbours(tile) & free_tiles for tile in blocked)
    stood = [(o.x, o.y) for o in players]
    faced = [(o.x + o.direction[0], o.y + o.direction[1]) for o in players if o.direction]
    assert len(set(stood)) == len(set(faced)) == len(players)
    assert set(stood) <= free_tiles
    assert set(faced) <= blocked


def neighbours(tile: tuple[int, int]) -> set[tuple[int, int]]:
    x, y = tile
    return {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)}


def reached(start: tuple[int, int], tiles: set[tuple[int, int]]) -> set[tuple[int, int]]:
    found, pending = {start}, [start]
    while pending:
        new = neighbours(pending.pop()) & tiles - found
        found |= new
        pending += new
    return found


@QUICK
@given(generators, seeds)
def test_original_objects_are_kept(source: Generator, seed: int) -> None:
    before, after = source.task.problem, draw(source, seed).task.problem
    for type_, things in before.objects.items():
        now = after.objects[type_][: len(things)]
        assert [(o.name, o.predicates, o.id) for o in now] == [
            (o.name, o.predicates, o.id) for o in things
        ]
    for type_ in source.task.domain.player_types:
        assert len(after.objects[type_]) == len(before.objects[type_])
    assert after.goal == before.goal
    assert after.goal_description == before.goal_description
    assert (after.seats, after.config, after.domain) == (before.seats, before.config, before.domain)


@QUICK
@given(generators, seeds)
def test_requested_objects_are_added(source: Generator, seed: int) -> None:
    parameters, domain = source.parameters, source.task.domain
    added = Counter[bool]()
    after = draw(source, seed).task.problem
    for type_, things in after.objects.items():
        new = len(things) - len(source.task.problem.objects.get(type_, ()))
        added[type_ in domain.station_types] += new
    stations, items = added[True], added[False]
    assert stations == parameters.stations or (parameters.stations is None and 2 <= stations <= 5)
    assert items == parameters.items or (parameters.items is None and 0 <= items <= 4)
    if parameters.width:
        assert (after.width, after.height) == (parameters.width, parameters.height)
    assert all(len(row) == after.width for row in after.ground or ())


@pytest.mark.slow
@FEW
@given(generators, seeds)
def test_linter_finds_no_faults(source: Generator, seed: int) -> None:
    instance = draw(source, seed)
    assert lint_task(instance.task) == []
    for seats in seats_of(source.task):
        world = instance.world(seats)
        assert len(world.players) == seats
        assert not world.initial.goal_reached


@pytest.mark.slow
@QUICK
@given(noisy, seeds)
def test_original_plans_work_in_noisy_instances(source: Generator, seed: int) -> None:
    instance = draw(source, seed)
    for seats in seats_of(source.task):
        original = replace(source.task, seats=seats)
        plan = shipped_plan(original)
        world = instance.world(seats)
        report = replay(instance.renaming(seats).carry(plan, world), world)
        assert report.rejection is None
        assert report.reached_at == len(plan)


@QUICK
@given(noisy, seeds)
def test_relations_are_kept_in_noisy_instances(source: Generator, seed: int) -> None:
    instance = draw(source, seed)
    seats = source.task.seats
    rename = instance.renaming(seats)
    before = World(replace(source.task, seats=seats)).initial.atoms()
    after = set(instance.world(seats).initial.atoms())
    kept = {(atom[0], *map(rename, atom[1:])) for atom in before}
    assert kept <= after
    originals = set(rename.names.values())
    for atom in after - kept:
        assert not originals & set(atom[1:]), atom


@QUICK
@given(free, seeds)
def test_objects_are_stacked_only_if_allowed(source: Generator, seed: int) -> None:
    facts = draw(source, seed).world().initial.atoms()
    stacked = [atom for atom in facts if atom[0] == "atop"]
    held = [atom for atom in facts if atom[0] in ("has_item", "has_container", "carries")]
    assert source.parameters.stacking is not False or not stacked
    assert source.parameters.held or not held
