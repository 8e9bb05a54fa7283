"""Packs as values: look-ups, budgets, loading, digests; and the pack of the shipped files."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from robotouille import World, load_task
from robotouille.errors import FileError, RobotouilleError, UnknownNameError
from robotouille.generation.paper_instances import paper_tasks
from robotouille.planning import replay
from robotouille_evaluation.packs.budgets import own_budget, published_budget
from robotouille_evaluation.packs.checking import check_pack
from robotouille_evaluation.packs.own import build_own_pack, instance_id
from robotouille_evaluation.packs.pack import KnownPlan, Pack


@cache
def ours() -> Pack:
    return build_own_pack()


SANDWICH = "synchronous/01_cheese_sandwich"


def test_our_pack_has_the_tasks_of_the_paper() -> None:
    assert tuple(task.name for task in ours().tasks) == paper_tasks()
    assert ours().datasets == ("synchronous", "asynchronous", "multi_agent")
    for task in ours().tasks:
        kinds = [instance.kind for instance in ours().instances_of([task.name])]
        assert kinds[0] == "default"
        assert kinds == sorted(kinds, key=("default", "free", "noisy").index)
        assert "free" in kinds


def test_tasks_are_found_by_their_numbers_and_dishes() -> None:
    for said in (SANDWICH, "synchronous/01", "synchronous/1", "cheese_sandwich"):
        assert ours().task(said).name == SANDWICH
    with pytest.raises(UnknownNameError, match="is not one task but 3: synchronous/01_cheese"):
        ours().task("01")
    with pytest.raises(UnknownNameError, match="did you mean 'synchronous/01_cheese_sandwich'"):
        ours().task("synchronous/01_chese_sandwich")
    with pytest.raises(UnknownNameError, match="; synchronous has synchronous/01_cheese"):
        ours().task("synchronous/00")


def test_our_ids_are_no_published_ones() -> None:
    for instance in ours().instances:
        assert instance.id == instance_id(instance.task, instance.kind, instance.seed)
        assert instance.id.count("/") == 2


def test_an_instance_is_the_shipped_task() -> None:
    free = ours().instances_of([SANDWICH], ["free"])[0]
    shipped = load_task(f"generated/{SANDWICH}_s{free.seed}")
    loaded = ours().load(free)
    assert loaded.name == free.id
    assert replace(loaded, name=shipped.name).digest == shipped.digest


def test_plans_are_those_that_certificates_prove() -> None:
    for name in (SANDWICH, "multi_agent/01_lettuce_burger"):
        instance = ours().instance(f"{name}/default")
        for known in instance.plans:
            world = World(ours().load(instance, seats=known.seats))
            plan = ours().plan(instance, world)
            assert len(plan) == known.steps
            assert instance.optimal(known.seats) == (known.steps if known.proven else None)
            assert replay(plan, world).ok
        assert ours().task(name).optimal == instance.optimal()


def test_a_plan_that_nobody_proved_is_an_error() -> None:
    instance = replace(ours().instance(f"{SANDWICH}/default"), plans=())
    with pytest.raises(RobotouilleError, match="no plan is known for 1 players"):
        ours().plan(instance, World(ours().load(instance)))


@pytest.mark.parametrize(
    ("look_up", "words"),
    [
        (lambda: ours().task("synchronous/01_chese_sandwich"), f"did you mean '{SANDWICH}'"),
        (lambda: ours().instance(f"{SANDWICH}/defalt"), f"did you mean '{SANDWICH}/default'"),
        (lambda: ours().prompt("ReAct"), "there is no prompt 'ReAct'"),
        (lambda: ours().example_set("io"), "there is no examples 'io'"),
        (lambda: ours().experiment("IO"), "there is no experiment 'IO'"),
        (lambda: ours().instances_of(["pizza"]), "there is no task 'pizza'"),
        (lambda: ours().load("pizza"), "there is no instance 'pizza'"),
    ],
)
def test_a_name_that_is_none_is_an_error_with_the_nearest(look_up, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UnknownNameError) as caught:
        look_up()
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("constant", "most"), [(21, 32), (10, 15), (23, 35), (82, 123), (1, 2), (0, 0)]
)
def test_a_run_goes_on_while_its_steps_are_fewer_than_the_budget(constant: int, most: int) -> None:
    budget = published_budget(constant)
    assert budget.steps == 1.5 * constant
    assert budget.max_steps == most
    assert next(taken for taken in range(most + 1) if not taken < budget.steps) == most


@pytest.mark.parametrize(
    ("plan", "bound", "words"),
    [
        (("-", "-"), 2, "does not reach the goal"),
        (("# a comment",), 1, "has lines that are no steps"),
        (("- -",), 1, "plan for 1 players"),
        (None, 99, "every plan at least 99"),
        (None, -1, "every plan at least -1"),
    ],
)
def test_a_plan_that_is_none_is_a_fault(
    plan: tuple[str, ...] | None, bound: int, words: str
) -> None:
    instance = ours().instance(f"{SANDWICH}/default")
    known = instance.best()
    assert known is not None
    forged = KnownPlan(1, known.plan if plan is None else plan, bound)
    one = replace(ours(), instances=(replace(instance, plans=(known,)),))
    assert check_pack(one) == []
    faults = check_pack(replace(one, instances=(replace(instance, plans=(forged,)),)))
    assert len(faults) == 1 and words in faults[0], faults


def test_budgets_say_of_which_kind_they_are() -> None:
    free = ours().instances_of([SANDWICH], ["free"])[0]
    published, own = ours().budget(free, "published"), ours().budget(free, "own")
    assert published == published_budget(ours().task(SANDWICH).optimal or 0)
    assert own == own_budget(free.optimal() or 0)
    assert (published.kind, own.kind) == ("published", "own")


def test_a_budget_of_nothing_is_an_error() -> None:
    unproven = replace(ours().instance(f"{SANDWICH}/default"), plans=())
    with pytest.raises(RobotouilleError, match="no known plan, so there is no own budget"):
        ours().budget(unproven, "own")
    task = replace(ours().task(SANDWICH), optimal=None)
    with pytest.raises(RobotouilleError, match="no constant"):
        replace(ours(), tasks=(task,)).budget(unproven, "published")


def test_the_usual_number_of_players_counts() -> None:
    instance = replace(
        ours().instance("multi_agent/01_lettuce_burger/default"),
        seats=2,
        plans=(KnownPlan(3, ("-",), 1),),
    )
    assert instance.optimal() is None
    assert instance.optimal(3) == 1


def test_equal_packs_have_equal_digests() -> None:
    again = replace(ours(), name=ours().name)
    assert again == ours()
    assert again.digest == ours().digest
    assert replace(ours(), version="2").digest != ours().digest


def test_a_pack_that_does_not_hold_together_is_told_so() -> None:
    instance = ours().instance(f"{SANDWICH}/default")
    pack = replace(
        ours(),
        tasks=ours().tasks[:1],
        instances=(instance, instance, replace(instance, id="x", task="y", problem="{}")),
    )
    faults = check_pack(pack)
    assert f"instance {SANDWICH}/default: is there 2 times" in faults
    assert "instance x: there is no task 'y'" in faults
    assert any(fault.startswith("ours: x: width") for fault in faults)
    assert check_pack(replace(pack, instances=(instance,))) == []


def test_faults_of_a_problem_are_named_with_the_pack() -> None:
    instance = replace(ours().instance(f"{SANDWICH}/default"), problem='{"width": 0}')
    with pytest.raises(FileError, match=rf"ours: {SANDWICH}/default: width"):
        ours().load(instance)
