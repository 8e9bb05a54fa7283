"""Instances of text games: the benchmark's to test on, and new ones to train on."""

from __future__ import annotations

from itertools import islice

import pytest

from robotouille import RobotouilleError, World, WrongArgumentError
from robotouille.planning.plan import replay
from robotouille_evaluation.packs import build_shift_pack
from robotouille_evaluation.text_games import DATASETS, Instances, load_instance


@pytest.mark.parametrize(("dataset", "count"), list(zip(DATASETS, (100, 100, 100, 6), strict=True)))
def test_test_split_has_the_instances_of_the_benchmark(dataset: str, count: int) -> None:
    names = list(Instances(dataset, "test"))
    assert len(set(names)) == len(names) == count
    assert all(f"{dataset}/" in name for name in names)
    if dataset == "shifts":
        assert names == [task.name for task in build_shift_pack().tasks]
        return
    kinds = {load_instance(name).task.problem.provenance.kind for name in names[:5]}
    assert kinds == {"free"}


def test_training_instances_alternate_between_tasks_and_never_end() -> None:
    names = Instances("synchronous", "train", ["01", "hamburger"])
    assert names.endless
    assert list(islice(names, 3)) == [
        "synchronous/01_cheese_sandwich#1000",
        "synchronous/04_hamburger#1000",
        "synchronous/01_cheese_sandwich#1001",
    ]
    assert names.name(10**6).endswith("#501000")
    with pytest.raises(TypeError, match="endless"):
        len(names)


def test_new_instance_has_a_plan_that_works() -> None:
    instance = load_instance("synchronous/01#1000")
    world = World(instance.task)
    assert replay(instance.plan(world), world).ok
    assert instance.optimum == len(instance.plan(world))
    assert instance.budget.steps == 1.5 * instance.optimum
    assert load_instance("synchronous/01#1001").task.digest != instance.task.digest


def test_unproven_team_instance_has_no_optimum() -> None:
    proven, open_ = load_instance("multi_agent/01"), load_instance("multi_agent/10@4")
    assert proven.optimum == 14
    assert open_.optimum is None
    assert open_.known is not None
    assert open_.budget.optimal == open_.known.steps


def test_shift_has_its_length_as_budget_and_no_plan() -> None:
    shift = load_instance("shifts/01")
    assert shift.budget.kind == "shift"
    with pytest.raises(WrongArgumentError, match="has no goal"):
        shift.plan(World(shift.task))


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("synchronous/soop", "no task"),
        ("/etc/passwd", "no task"),
        ("", "is not an instance"),
        ("synchronous/01#-1", "is not an instance"),
        ("synchronous/01#" + "9" * 10, "is not an instance"),
        ("synchronous/01@3", "seats"),
        ("multi_agent/01@9#1", "seats"),
        ("x" * 1_000_000, "is not an instance"),
    ],
)
def test_wrong_name_says_what_is_wrong(name: str, why: str) -> None:
    with pytest.raises(RobotouilleError, match=why):
        load_instance(name)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("soups",), "expected one of 'synchronous'"),
        (("synchronous", "valid"), "expected one of 'train', 'test'"),
        (("synchronous", "test", ["99"]), "is not one task of synchronous; synchronous has "),
    ],
)
def test_unknown_data_set_says_what_there_is(arguments: tuple[str, ...], why: str) -> None:
    with pytest.raises(WrongArgumentError, match=why):
        Instances(*arguments)


def test_number_outside_a_split_is_an_error() -> None:
    with pytest.raises(IndexError, match="0 to 99, not 100"):
        Instances("synchronous").name(100)
    with pytest.raises(IndexError, match="no instance"):
        Instances("synchronous", "train").name(10**12)
