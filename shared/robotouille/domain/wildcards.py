"""Objects named by their type (`"name": "item"`): any kind will do, and a seed decides which."""

from __future__ import annotations

import random

from robotouille.domain.schema import DomainFile, ObjectDef, ProblemFile

__all__ = ["resolve_wildcards"]


def resolve_wildcards(problem: ProblemFile, domain: DomainFile, seed: int) -> ProblemFile:
    """Give every object that is named by its type one of the domain's `kinds` of that type.

    The same seed gives the same kinds everywhere.
    """
    generator = random.Random(seed)
    objects = {
        kind: tuple(_resolve(thing, kind, domain, generator) for thing in things)
        for kind, things in problem.objects.items()
    }
    return (
        problem if objects == problem.objects else problem.model_copy(update={"objects": objects})
    )


def _resolve(
    thing: ObjectDef, kind: str, domain: DomainFile, generator: random.Random
) -> ObjectDef:
    kinds = domain.kinds.get(kind)
    if thing.name != kind or not kinds:
        return thing
    return thing.model_copy(update={"name": generator.choice(kinds)})
