"""Attempts, proofs and impossible requests."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import pytest

from robotouille import FileError, World, load_task
from robotouille.generation import (
    SEEDS,
    GenerationError,
    Generator,
    Kind,
    Parameters,
    generate,
    generate_dataset,
    paper_tasks,
    seeds_from,
)
from robotouille.generation.generator import kind_at
from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.plan import Plan, Proof, SearchResult, read_plan, replay
from tests.generation.kitchens import Oracle, crowded, shipped_plan
from tests.support.samples import quick_sample

GOLDEN = Path(__file__).parent / "golden"
SANDWICH = "synchronous/01_cheese_sandwich"


def beam(world: World) -> SearchResult:
    """Return some plan quickly."""
    found = BeamPlanner(world).solve(world.initial, expansions=300)
    return SearchResult(found.plan if found.reached else None, 0, Proof.NONE, "beam", 0)


def exact(world: World) -> SearchResult:
    """Return some plan as if it were proven shortest."""
    answer = beam(world)
    assert answer.plan is not None
    reached = replay(answer.plan, world).reached_at or 0
    return SearchResult(answer.plan, reached, Proof.EXHAUSTED, "beam", 0)


def test_golden_instances() -> None:
    for path in sorted(GOLDEN.glob("*.json")):
        received = load_task(str(path)).problem.provenance
        assert received is not None
        source = load_task(received.source)
        generator = Generator(source, Kind(received.kind), Parameters(**received.parameters))
        assert generator.draw(received.seed, received.attempt).text == path.read_text()


def test_loaded_file_equals_the_task(tmp_path: Path) -> None:
    instance = Generator(load_task("multi_agent/01"), Kind.NOISY).instance(84)
    assert instance.name == "01_lettuce_burger_s84"
    path = tmp_path / f"{instance.name}.json"
    path.write_text(instance.text)
    for seats in (2, 3, 4):
        task = load_task(str(path), seats=seats)
        assert task.digest == instance.world(seats).task.digest
        world = World(task)
        assert replay(read_plan(instance.plan_text(seats), world), world).ok


# Proofs


def test_free_instance_has_a_plan() -> None:
    instance = generate(load_task(SANDWICH), 42)
    assert instance.provenance.attempt == 1
    world = instance.world()
    assert replay(read_plan(instance.plan_text(), world), world).ok


def test_noisy_instance_needs_no_search() -> None:
    solver = Oracle()
    source = load_task("multi_agent/01")
    instance = Generator(source, Kind.NOISY, solver=solver).instance(1)
    assert solver.asked == 0
    assert instance.results.keys() == {2, 3, 4}
    assert len(instance.results[2].plan or ()) == len(shipped_plan(source))


def test_original_without_plan_is_solved_once(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text(Path(load_task(SANDWICH).source).read_text())
    asked = []

    def solver(world: World) -> SearchResult:
        asked.append(world)
        return beam(world)

    generator = Generator(load_task(str(path)), Kind.NOISY, solver=solver)
    plans = [generator.instance(seed).results[1].plan for seed in (1, 2, 3)]
    assert len(asked) == 1
    assert len({len(plan or ()) for plan in plans}) == 1


def test_unsolvable_attempt_is_followed_by_another() -> None:
    oracle = Oracle(refuse=2)

    def solver(world: World) -> SearchResult:
        answer = oracle(world)
        return answer if answer.unsolvable else beam(world)

    generator = Generator(load_task(SANDWICH), solver=solver)
    instance = generator.instance(5)
    assert instance.provenance.attempt == 3
    assert instance.text == generator.draw(5, 3).text
    assert '"attempt": 3' in instance.text


def test_error_if_no_attempt_can_be_solved() -> None:
    generator = Generator(load_task(SANDWICH), solver=Oracle(), attempts=4)
    with pytest.raises(GenerationError) as error:
        generator.instance(5)
    assert error.value.parameter == "solver"
    assert str(error.value) == (
        f"solver: no free instance of {SANDWICH} with seed 5 in 4 attempts; "
        "last attempt: no plan was found for 1 players"
    )
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)


# Difficulty


@pytest.mark.slow
def test_plan_length_is_in_the_requested_range() -> None:
    lengths = []

    def solver(world: World) -> SearchResult:
        answer = beam(world)
        lengths.append(replay(answer.plan or Plan(()), world).reached_at or 0)
        return replace(answer, bound=lengths[-1] if len(lengths) == 3 else 0)

    parameters = Parameters(min_steps=1, max_steps=40)
    instance = Generator(load_task(SANDWICH), parameters=parameters, solver=solver).instance(1)
    assert instance.provenance.attempt == 3
    assert instance.provenance.parameters == {"min_steps": 1, "max_steps": 40}
    assert len(instance.results[1].plan or ()) == lengths[-1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", quick_sample(Kind))
@pytest.mark.parametrize(
    ("parameters", "name"),
    [(Parameters(max_steps=2), "max_steps"), (Parameters(min_steps=99), "min_steps")],
)
def test_unreachable_plan_length_is_an_error(kind: Kind, parameters: Parameters, name: str) -> None:
    generator = Generator(load_task(SANDWICH), kind, parameters, solver=exact, attempts=2)
    with pytest.raises(
        GenerationError, match=r"2 attempts; last attempt: .* the shortest plan"
    ) as e:
        generator.instance(1)
    assert e.value.parameter == name


def test_unproven_plan_length_is_rejected() -> None:
    generator = Generator(
        load_task(SANDWICH), parameters=Parameters(min_steps=1), solver=beam, attempts=1
    )
    with pytest.raises(GenerationError, match=r"between 0 and \d+ \(not proven\)"):
        generator.instance(1)


# Impossible requests


@pytest.mark.parametrize(
    ("kind", "parameters", "name"),
    [
        (Kind.FREE, Parameters(width=3, height=3), "size"),
        (Kind.NOISY, Parameters(width=2, height=2), "size"),
        (Kind.FREE, Parameters(width=6, height=6, stations=30), "size"),
        (Kind.FREE, Parameters(items=20, stacking=False), "items"),
        (Kind.NOISY, Parameters(stations=2, items=3), "items"),
        (Kind.NOISY, Parameters(stations=0, items=1, stacking=True), "items"),
        (Kind.NOISY, Parameters(items=1, stations=0), "items"),
    ],
)
def test_contradictory_parameters_are_rejected(
    kind: Kind, parameters: Parameters, name: str
) -> None:
    generator = Generator(load_task(SANDWICH), kind, parameters, solver=beam, attempts=5)
    with pytest.raises(GenerationError) as error:
        generator.instance(1)
    assert error.value.parameter == name


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"width": 0}, "width"),
        ({"height": 101}, "height"),
        ({"stations": -1}, "stations"),
        ({"items": 1001}, "items"),
        ({"min_steps": 0}, "min_steps"),
        ({"min_steps": 5, "max_steps": 4}, "min_steps"),
    ],
)
def test_invalid_parameters_are_rejected(values: dict[str, int], name: str) -> None:
    with pytest.raises(GenerationError) as error:
        Parameters(**values)
    assert error.value.parameter == name


def test_noisy_instances_reject_held() -> None:
    with pytest.raises(GenerationError, match=r"^held: "):
        Generator(load_task(SANDWICH), Kind.NOISY, Parameters(held=True))


@pytest.mark.parametrize("attempts", [0, 1_000_000_000])
def test_number_of_attempts_is_limited(attempts: int) -> None:
    with pytest.raises(GenerationError, match=rf"^attempts: expected 1 to .*found {attempts}$"):
        Generator(load_task(SANDWICH), attempts=attempts)


def test_too_many_stations_are_rejected() -> None:
    generator = Generator(load_task(SANDWICH), parameters=Parameters(width=2, stations=900))
    with pytest.raises(GenerationError, match=r"^stations: 905 do not fit on any grid"):
        generator.draw(1)
    generator = Generator(load_task(SANDWICH), parameters=Parameters(items=1000))
    with pytest.raises(GenerationError, match=r"^items: 1\d+ objects in total; at most 1000"):
        generator.draw(1)


# Everything that may be on a tile


def test_stacks_hands_and_contents_are_kept_in_noisy_instances(tmp_path: Path) -> None:
    task = crowded(tmp_path)
    instance = Generator(task, Kind.NOISY).draw(3)
    rename = instance.renaming()
    before, after = World(task).initial.atoms(), set(instance.world().initial.atoms())
    assert {(atom[0], *map(rename, atom[1:])) for atom in before} <= after
    assert ("has_item", rename("robot1"), rename("patty2")) in after
    assert ("in", rename("water1"), rename("pot1")) in after
    assert instance.task.problem.config == {
        "cook_time": {"default": 2, rename("patty2"): 7},
        "boil_time": {rename("water1"): 9},
    }


def test_contents_stay_in_their_vessels_in_free_instances(tmp_path: Path) -> None:
    generator = Generator(crowded(tmp_path), parameters=Parameters(held=True))
    held = stacked = 0
    for seed in range(12):
        instance = generator.draw(seed)
        facts = instance.world().initial.atoms()
        rename = instance.renaming()
        assert ("in", rename("water1"), rename("pot1")) in set(facts)
        held += any(atom[0].startswith("has_") for atom in facts)
        stacked += any(atom[0] == "atop" for atom in facts)
    assert 0 < held < 12
    assert stacked > 0


def test_larger_grid_has_a_floor_everywhere(tmp_path: Path) -> None:
    instance = Generator(crowded(tmp_path), parameters=Parameters(width=7, height=6)).draw(1)
    assert instance.task.problem.ground == ("ABCDEEE",) * 6
    narrow = Generator(crowded(tmp_path), parameters=Parameters(stations=30)).draw(1)
    assert narrow.task.problem.width * narrow.task.problem.height >= 2.5 * 34


def test_task_with_faults_is_rejected(tmp_path: Path) -> None:
    items = [{"name": "patty", "x": 1, "y": 2}]
    with pytest.raises(FileError, match="lies on the floor"):
        Generator(crowded(tmp_path, items=items, goal=[]))


# Datasets


@pytest.mark.slow
def test_dataset_order_and_kinds() -> None:
    assert len(paper_tasks()) == 30
    assert seeds_from(42, 10) == (42, 84, 126, 168, 210, 252, 294, 336, 378, 420)
    found = list(generate_dataset([SANDWICH], seeds_from(42, 4), solver=beam))
    assert [i.name for i in found] == [f"01_cheese_sandwich_s{s}" for s in (42, 84, 126, 168)]
    assert [i.provenance.kind for i in found] == ["free", "noisy", "free", "noisy"]
    kinds = [kind_at(position) for position, _ in enumerate(SEEDS, start=1)]
    assert (kinds.count(Kind.FREE), kinds.count(Kind.NOISY)) == (10, 5)
