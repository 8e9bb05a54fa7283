"""Actions over some objects: every choice of arguments that static facts allow."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod

from robotouille.domain.schema import Condition
from robotouille.planning.search.relaxation.abstract_objects import AbstractObjects
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.grounding.atoms import AtomTable
from robotouille.world.grounding.objects import bound

__all__ = ["MAX_CHOICES", "Grounding", "TooLargeError"]

MAX_CHOICES = 100_000


class TooLargeError(ValueError):
    """A task has too many ground actions for a relaxation to be worth its while."""


class Grounding:
    """Grounds action schemas; conditions on predicates that nothing changes are settled here."""

    def __init__(self, table: AtomTable, objects: AbstractObjects) -> None:
        self._table = table
        self._objects = objects

    def bindings(self, schema: ActionSchema) -> Iterator[dict[str, str]]:
        """Arguments for an action's parameters. Raises TooLargeError before there are too many."""
        static = [c for c in schema.definition.precons if self.is_static(c)]
        pools = [
            [
                choice
                for choice in self._objects.of_type(kind)
                if all(
                    self.static_holds(c, {name: choice}) for c in static if set(c.params) == {name}
                )
            ]
            for name, kind in schema.parameters
        ]
        if prod(map(len, pools)) > MAX_CHOICES:
            raise TooLargeError(f"more than {MAX_CHOICES} choices of arguments of {schema.name}")
        yield from self._choose(schema, pools, static, {})

    def _choose(
        self,
        schema: ActionSchema,
        pools: list[list[str]],
        static: list[Condition],
        binding: dict[str, str],
    ) -> Iterator[dict[str, str]]:
        if not all(
            self.static_holds(c, binding)
            for c in static
            if all(name in binding for name in c.params)
        ):
            return
        if len(binding) == len(pools):
            yield binding
            return
        name, _ = schema.parameters[len(binding)]
        for choice in pools[len(binding)]:
            yield from self._choose(schema, pools, static, {**binding, name: choice})

    def is_static(self, condition: Condition) -> bool:
        return condition.predicate in self._table.static_predicates

    def static_holds(self, condition: Condition, binding: dict[str, str]) -> bool:
        return (bound(condition, binding) in self._table.static) == condition.is_true
