"""Shortest plans of a pack's instances, proven: `own` budgets and measures of quality need them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from robotouille.certification.certificate import Deadline, ExpansionBudget, Solver, certify
from robotouille_evaluation.packs.pack import InstanceKind, KnownPlan, Pack, PackInstance

__all__ = ["EXPANSIONS", "KINDS", "SECONDS", "prove_instances", "with_instances"]

EXPANSIONS = 100_000
"""What a search for one player may cost; for two, a 50th of it."""

SECONDS = 60.0

KINDS: tuple[InstanceKind, ...] = ("default", "free")
"""Noisy instances are left out: many cannot be solved."""

Progress = Callable[[int, int], None]
"""Called with the number of instances that are done, and of all."""


def prove_instances(
    pack: Pack,
    solver: Solver,
    *,
    kinds: Iterable[InstanceKind] = KINDS,
    expansions: int = EXPANSIONS,
    seconds: float = SECONDS,
    progress: Progress | None = None,
) -> Iterator[PackInstance]:
    """The instances of a pack that have no proven plan, with one where the planner found it.

    Args:
        expansions: How many states a search may expand for one player.
        seconds: How long a search may take; what it gives up then depends on the machine.

    Raises:
        RobotouilleError: An instance has faults, or the planner's answer does not hold.
    """
    unproven = [i for i in pack.instances_of(kinds=kinds) if i.optimal() is None]
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
    """The pack with some of its instances exchanged, by id; its digest is another then."""
    others = {instance.id: instance for instance in changed}
    instances = tuple(others.get(instance.id, instance) for instance in pack.instances)
    return replace(pack, instances=instances)
