"""Whether a pack holds together: names, references, and every instance as a world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import chain

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille.planning import read_plan, replay
from robotouille_evaluation.packs.pack import KnownPlan, Pack, PackInstance

__all__ = ["check_pack"]

Progress = Callable[[int, int], None]
"""Called with the number of instances that are checked, and of all."""


def check_pack(pack: Pack, progress: Progress | None = None) -> list[str]:
    """What is wrong with a pack, each with its place; empty if it can be evaluated on.

    An experiment may name tasks that the pack has not: a checkout need not be whole. That no plan
    is shorter is not proven again.
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
            yield f"{what} {name}: is there {count} times"


def _dangling(pack: Pack) -> Iterator[str]:
    tasks = {task.name for task in pack.tasks}
    for instance in pack.instances:
        if instance.task not in tasks:
            yield f"instance {instance.id}: there is no task {instance.task!r}"
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
        yield f"{place}: has lines that are no steps"
    elif not replay(plan, world).ok:
        yield f"{place}: does not reach the goal"
    if not 0 <= known.bound <= known.steps:
        yield f"{place}: has {known.steps} steps, and every plan at least {known.bound}?"
