"""Packs as values: look-ups, budgets, loading, digests, and the built-in pack."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robotouille import World, load_task, task_names
from robotouille.errors import RobotouilleError, UnknownNameError
from robotouille.generation.generator import paper_tasks
from robotouille.planning import replay
from robotouille_evaluation.packs.budget import published_budget
from robotouille_evaluation.packs.checking import check_pack
from robotouille_evaluation.packs.own import build_own_pack as ours
from robotouille_evaluation.packs.own import build_shift_pack
from robotouille_evaluation.packs.pack import KnownPlan

SANDWICH = "synchronous/01_cheese_sandwich"


def test_tasks_of_the_built_in_pack() -> None:
    assert tuple(task.name for task in ours().tasks) == paper_tasks()
    assert ours().datasets == ("synchronous", "asynchronous", "multi_agent")
    for task in ours().tasks:
        kinds = [instance.kind for instance in ours().instances_of([task.name])]
        assert kinds[0] == "default"
        assert kinds == sorted(kinds, key=("default", "free", "noisy").index)
        assert "free" in kinds


def test_shifts_are_a_pack_with_the_points_of_planners() -> None:
    pack = build_shift_pack()
    shifts = [name for name in task_names() if name.startswith("shifts/")]
    assert [task.name for task in pack.tasks] == shifts
    assert pack.datasets == ("shifts",)
    assert pack.usual_kinds == ("default",)
    for instance in pack.instances:
        shift = pack.shift(instance)
        assert shift is not None
        assert shift.planner.keys() == set(pack.load(instance).problem.seats or ())
        assert pack.budget(instance, "shift").max_steps == shift.steps
    assert not check_pack(pack)
    (react,) = (prompt for prompt in pack.prompts if prompt.id == "react")
    assert "open orders" in react.instructions and "{" not in react.instructions


def test_tasks_by_number_and_dish() -> None:
    for said in (SANDWICH, "synchronous/01", "synchronous/1", "cheese_sandwich"):
        assert ours().task(said).name == SANDWICH
    with pytest.raises(UnknownNameError, match="is ambiguous; choose synchronous/01_cheese"):
        ours().task("01")
    with pytest.raises(UnknownNameError, match="did you mean 'synchronous/01_cheese_sandwich'"):
        ours().task("synchronous/01_chese_sandwich")
    with pytest.raises(UnknownNameError, match="; synchronous has synchronous/01_cheese"):
        ours().task("synchronous/00")


def test_instance_loads_the_shipped_task() -> None:
    free = ours().instances_of([SANDWICH], ["free"])[0]
    shipped = load_task(f"generated/{SANDWICH}_s{free.seed}")
    loaded = ours().load(free)
    assert loaded.name == free.id
    assert replace(loaded, name=shipped.name).digest == shipped.digest


def test_plans_come_from_certificates() -> None:
    for name in (SANDWICH, "multi_agent/01_lettuce_burger"):
        instance = ours().instance(f"{name}/default")
        for known in instance.plans:
            world = World(ours().load(instance, seats=known.seats))
            plan = ours().plan(instance, world)
            assert len(plan) == known.steps
            assert instance.optimal(known.seats) == (known.steps if known.proven else None)
            assert replay(plan, world).ok
        assert ours().task(name).optimal == instance.optimal()


def test_unknown_plan_is_an_error() -> None:
    instance = replace(ours().instance(f"{SANDWICH}/default"), plans=())
    with pytest.raises(RobotouilleError, match="no plan is known for 1 players"):
        ours().plan(instance, World(ours().load(instance)))


@pytest.mark.parametrize(
    ("look_up", "words"),
    [
        (lambda: ours().task("synchronous/01_chese_sandwich"), f"did you mean '{SANDWICH}'"),
        (lambda: ours().instance(f"{SANDWICH}/defalt"), f"did you mean '{SANDWICH}/default'"),
        (lambda: ours().task("training/03"), "the pack ours has tasks of synchronous, "),
        (lambda: ours().prompt("ReAct"), "unknown prompt 'ReAct'"),
        (lambda: ours().example_set("io"), "unknown examples 'io'"),
        (lambda: ours().experiment("IO"), "unknown experiment 'IO'"),
        (lambda: ours().instances_of(["pizza"]), "unknown task 'pizza'"),
        (lambda: ours().load("pizza"), "unknown instance 'pizza'"),
    ],
)
def test_unknown_names_suggest_the_nearest(look_up, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(UnknownNameError) as caught:
        look_up()
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("constant", "most"), [(21, 32), (10, 15), (23, 35), (82, 123), (1, 2), (0, 0)]
)
def test_max_steps_of_budgets(constant: int, most: int) -> None:
    budget = published_budget(constant)
    assert budget.steps == 1.5 * constant
    assert budget.max_steps == most
    assert next(taken for taken in range(most + 1) if not taken < budget.steps) == most


@pytest.mark.parametrize(
    ("plan", "bound", "words"),
    [
        (("-", "-"), 2, "does not reach the goal"),
        (("# a comment",), 1, "some lines are not steps"),
        (("- -",), 1, "plan for 1 players"),
        (None, 99, "impossible lower bound 99"),
        (None, -1, "impossible lower bound -1"),
    ],
)
def test_invalid_plans_are_faults(plan: tuple[str, ...] | None, bound: int, words: str) -> None:
    instance = ours().instance(f"{SANDWICH}/default")
    known = instance.best()
    assert known is not None
    forged = KnownPlan(1, known.plan if plan is None else plan, bound)
    one = replace(ours(), instances=(replace(instance, plans=(known,)),))
    assert check_pack(one) == []
    faults = check_pack(replace(one, instances=(replace(instance, plans=(forged,)),)))
    assert len(faults) == 1 and words in faults[0], faults


def test_unknown_budget_is_an_error() -> None:
    unproven = replace(ours().instance(f"{SANDWICH}/default"), plans=())
    with pytest.raises(RobotouilleError, match="no known plan, so no own budget"):
        ours().budget(unproven, "own")
    task = replace(ours().task(SANDWICH), optimal=None)
    with pytest.raises(RobotouilleError, match="no constant"):
        replace(ours(), tasks=(task,)).budget(unproven, "published")


def test_check_finds_faults() -> None:
    instance = ours().instance(f"{SANDWICH}/default")
    pack = replace(
        ours(),
        tasks=ours().tasks[:1],
        instances=(instance, instance, replace(instance, id="x", task="y", problem="{}")),
    )
    faults = check_pack(pack)
    assert f"instance {SANDWICH}/default: occurs 2 times" in faults
    assert "instance x: unknown task 'y'" in faults
    assert any(fault.startswith("ours: x: width") for fault in faults)
    assert check_pack(replace(pack, instances=(instance,))) == []
