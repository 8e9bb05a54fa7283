"""Checks of a pack's names, references, instances and plans, and proofs of shortest plans."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain

from robotouille import World
from robotouille.certification.certificate import Deadline, ExpansionBudget, Solver, certify
from robotouille.errors import RobotouilleError
from robotouille.planning import read_plan, replay
from robotouille_evaluation.packs.pack import InstanceKind, KnownPlan, Pack, PackInstance

Progress = Callable[[int, int], None]
"""Called with the number of finished instances and of all."""


def check_pack(pack: Pack, progress: Progress | None = None) -> list[str]:
    """Return the faults of a pack with their places.

    Experiments may name missing tasks, because a checkout need not be complete. Optima are not
    proven again.
    """
    faults = [*_repeated(pack), *_dangling(pack)]
    for number, instance in enumerate(pack.instances, start=1):
        try:
            World(pack.load(instance))
            for known in instance.plans:
                faults += _plan_faults(pack, instance, known)
        except RobotouilleError as error:
            faults += str(error).splitlines()
        if progress is not None:
            progress(number, len(pack.instances))
    return faults


def _repeated(pack: Pack) -> Iterator[str]:
    names = Counter(
        chain(
            (("task", task.name) for task in pack.tasks),
            (("instance", instance.id) for instance in pack.instances),
            (("prompt", prompt.id) for prompt in pack.prompts),
            (("examples", examples.name) for examples in pack.examples),
            (("experiment", experiment.id) for experiment in pack.experiments),
        )
    )
    for (what, name), count in names.items():
        if count > 1:
            yield f"{what} {name}: occurs {count} times"


def _dangling(pack: Pack) -> Iterator[str]:
    tasks = {task.name for task in pack.tasks}
    for instance in pack.instances:
        if instance.task not in tasks:
            yield f"instance {instance.id}: unknown task {instance.task!r}"
    prompts = {prompt.id for prompt in pack.prompts}
    examples = {found.name for found in pack.examples}
    for experiment in pack.experiments:
        absent = [f"no prompt {id_!r}" for id_ in experiment.prompt_ids if id_ not in prompts]
        absent += [f"no examples {name!r}" for name in experiment.shown if name not in examples]
        yield from (f"experiment {experiment.id}: the pack has {what}" for what in absent)


def _plan_faults(pack: Pack, instance: PackInstance, known: KnownPlan) -> Iterator[str]:
    place = f"{instance.id}: plan for {known.seats} players"
    world = World(pack.load(instance, seats=known.seats))
    plan = read_plan("\n".join(known.plan), world, place)
    if len(plan) != known.steps:
        yield f"{place}: some lines are not steps"
    elif not replay(plan, world).ok:
        yield f"{place}: does not reach the goal"
    if not 0 <= known.bound <= known.steps:
        yield f"{place}: has {known.steps} steps and the impossible lower bound {known.bound}"


EXPANSIONS = 100_000
"""Expansions of a search for one player; for two, a 50th of it."""

SECONDS = 60.0

KINDS: tuple[InstanceKind, ...] = ("default", "free")
"""Noisy instances are left out, because many have no solution."""


def prove_instances(
    pack: Pack,
    solver: Solver,
    *,
    kinds: Iterable[InstanceKind] = KINDS,
    expansions: int = EXPANSIONS,
    seconds: float = SECONDS,
    progress: Progress | None = None,
) -> Iterator[PackInstance]:
    """Yield instances without a proven plan, with the plan that the solver has found.

    Args:
        expansions: Expansions of a search for one player.
        seconds: Time limit of a search. The result then depends on the machine.

    Raises:
        RobotouilleError: An instance is invalid, or the solver's result is wrong.
    """
    # Proven instances are skipped, so an interrupted command can continue.
    unproven = [
        i for i in pack.instances_of(kinds=kinds) if i.optimal() is None and pack.shift(i) is None
    ]
    budget = ExpansionBudget(expansions=expansions)
    for number, instance in enumerate(unproven, start=1):
        task = pack.load(instance)
        limits = budget.for_seats(task.seats).limits()
        certificate = certify(task, solver, replace(limits, stop=Deadline(seconds)))
        if certificate.optimal and certificate.plan is not None:
            others = [known for known in instance.plans if known.seats != task.seats]
            proven = KnownPlan(task.seats, certificate.plan, certificate.bound)
            yield replace(instance, plans=(*others, proven))
        if progress is not None:
            progress(number, len(unproven))


def with_instances(pack: Pack, changed: Iterable[PackInstance]) -> Pack:
    """Return the pack with some instances replaced by id, and so with a new digest."""
    others = {instance.id: instance for instance in changed}
    instances = tuple(others.get(instance.id, instance) for instance in pack.instances)
    return replace(pack, instances=instances)
