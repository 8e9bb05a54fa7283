"""Which actions apply: a decision tree for each player, grown where play goes.

A node tests some atoms at once: `facts & mask` selects a child. At the root these are the atoms
about the player (its place, its hand); below, those about what it has at hand. Parameters are
bound by the atoms that are true, so no action is ever made that could not apply there, and
listing the valid actions of a state takes a handful of dictionary look-ups.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import NamedTuple

from robotouille.domain.schema import Condition
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS, AtomTable
from robotouille.world.grounding.objects import Atom

__all__ = ["SuccessorTree"]

MAX_NODES = 40_000
"""Of one player's tree; then it grows anew."""


class Partial(NamedTuple):
    """An action schema with some parameters bound, and its conditions yet to be tested."""

    schema: ActionSchema
    binding: dict[str, str]
    open: tuple[Condition, ...]


class DecisionNode:
    """Tests `mask`; a leaf (mask 0) lists the actions that apply."""

    __slots__ = ("actions", "children", "mask", "partials")

    def __init__(
        self, mask: int, partials: tuple[Partial, ...], actions: tuple[GroundAction, ...]
    ) -> None:
        self.mask = mask
        self.partials = partials
        self.actions = actions
        self.children: dict[int, DecisionNode] = {}


class SuccessorTree:
    """The valid actions of one player, by state."""

    def __init__(
        self,
        player: str,
        kind: str,
        schemas: tuple[ActionSchema, ...],
        table: AtomTable,
        ground: Callable[[ActionSchema, tuple[str, ...]], GroundAction],
    ) -> None:
        self._player = player
        self._table = table
        self._ground = ground
        self._size = 0
        self._start = tuple(
            partial
            for schema in schemas
            if not schema.player or schema.parameters[0][1] == kind
            for partial in self._begin(schema)
        )
        self._root_mask = 0
        for partial in self._start:
            self._root_mask |= self._test(partial)
        self._buckets: dict[int, tuple[DecisionNode, ...]] = {}

    def actions(self, facts: int) -> tuple[GroundAction, ...]:
        """The actions that apply, as the domain orders them."""
        bucket = self._buckets.get(facts & self._root_mask)
        if bucket is None:
            bucket = self._new_bucket(facts)
        result: tuple[GroundAction, ...] = ()
        for top in bucket:
            node = top
            while node.mask:
                child = node.children.get(facts & node.mask)
                node = child if child is not None else self._new_child(node, facts)
            result += node.actions
        return result

    def forget(self) -> None:
        """Let the tree grow anew."""
        self._buckets.clear()
        self._size = 0

    def _new_bucket(self, facts: int) -> tuple[DecisionNode, ...]:
        partials = [p for start in self._start for p in self._advance(start, facts)]
        bucket = tuple(self._node(tuple(group)) for group in self._groups(partials))
        self._buckets[facts & self._root_mask] = bucket
        return bucket

    def _new_child(self, node: DecisionNode, facts: int) -> DecisionNode:
        advanced = tuple(p for partial in node.partials for p in self._advance(partial, facts))
        child = node.children[facts & node.mask] = self._node(advanced)
        return child

    def _node(self, partials: tuple[Partial, ...]) -> DecisionNode:
        if self._size >= MAX_NODES:
            self.forget()
        self._size += 1
        partials = tuple(
            p
            for partial in partials
            for p in self._enumerate(partial)
            if self._test(p) or len(p.binding) == len(p.schema.parameters)
        )
        mask = 0
        for partial in partials:
            mask |= self._test(partial)
        if mask:
            return DecisionNode(mask, partials, ())
        actions = [self._ground_action(partial) for partial in partials]
        return DecisionNode(0, (), tuple(sorted(actions, key=lambda a: a.key)))

    def _ground_action(self, partial: Partial) -> GroundAction:
        names = (name for name, _ in partial.schema.parameters)
        return self._ground(partial.schema, tuple(partial.binding[name] for name in names))

    def _groups(self, partials: list[Partial]) -> Iterator[list[Partial]]:
        """Split into parts whose tests concern the same objects, in the domain's order.

        What a place holds is tested together; which places are vacant, apart from it: else the
        number of nodes would be the product of both. Parts whose schemas interleave are joined,
        so that listing them one after the other keeps the order.
        """
        groups: list[list[Partial]] = []
        for partial in sorted(partials, key=lambda p: p.schema.index):
            if groups and (
                groups[-1][-1].schema is partial.schema
                or not partial.open
                or self._local(groups[-1][-1]) == self._local(partial)
            ):
                groups[-1].append(partial)
            else:
                groups.append([partial])
        return iter(groups)

    def _local(self, partial: Partial) -> bool:
        """Whether the next test of a partial concerns an object that is bound already."""
        return any(
            name in partial.binding and partial.binding[name] != self._player
            for condition in self._tested(partial)
            for name in condition.params
        )

    def _begin(self, schema: ActionSchema) -> Iterator[Partial]:
        binding = {schema.parameters[0][0]: self._player} if schema.player else {}
        conditions = schema.definition.precons + self._existence(schema)
        partial = self._settle(Partial(schema, binding, conditions))
        if partial is not None:
            yield partial

    def _existence(self, schema: ActionSchema) -> tuple[Condition, ...]:
        return tuple(
            Condition.model_construct(predicate=EXISTS, params=(name,), is_true=True)
            for name, kind in schema.parameters
            if kind in self._table.transient
        )

    def _settle(self, partial: Partial) -> Partial | None:
        """Decide the static conditions that are fully bound; None where one is violated."""
        still_open = []
        for condition in partial.open:
            fluent = condition.predicate not in self._table.static_predicates
            if fluent or any(name not in partial.binding for name in condition.params):
                still_open.append(condition)
            elif (
                self._atom(condition, partial.binding) in self._table.static
            ) != condition.is_true:
                return None
        return partial._replace(open=tuple(still_open))

    def _tested(self, partial: Partial) -> list[Condition]:
        """The conditions tested next: all that are bound, and those that bind one parameter.

        A condition binds a parameter through what is true of an object that is bound already;
        only where there is no such condition, through what is true of anything.
        """
        fluent = [c for c in partial.open if c.predicate not in self._table.static_predicates]
        free = [{n for n in c.params if n not in partial.binding} for c in fluent]
        settled = [c for c, names in zip(fluent, free, strict=True) if not names]
        binding = [
            c for c, names in zip(fluent, free, strict=True)
            if len(names) == 1 and c.is_true and c.predicate != EXISTS
        ]  # fmt: skip
        near = [c for c in binding if any(name in partial.binding for name in c.params)]
        return settled + (near or binding[:1])

    def _test(self, partial: Partial) -> int:
        mask = 0
        for condition in self._tested(partial):
            if condition.predicate == EXISTS:
                mask |= self._table.bit[(EXISTS, partial.binding[condition.params[0]])]
            else:
                pattern = (partial.binding.get(name) for name in condition.params)
                mask |= self._table.matching((condition.predicate, *pattern))
        return mask

    def _advance(self, partial: Partial, facts: int) -> Iterator[Partial]:
        """The partials that remain possible in `facts` once the next conditions are tested."""
        tested = self._tested(partial)
        pools: dict[str, list[str]] = {}
        for condition in tested:
            unbound = next((n for n in condition.params if n not in partial.binding), None)
            if unbound is None:
                atom = self._atom(condition, partial.binding)
                if bool(facts & self._table.bit[atom]) != condition.is_true:
                    return
            else:
                matching = self._objects(condition, unbound, partial.binding, facts)
                known = pools.get(unbound)
                pools[unbound] = [o for o in matching if known is None or o in known]
        rest = tuple(c for c in partial.open if c not in tested)
        for chosen in product(*pools.values()):
            binding = {**partial.binding, **dict(zip(pools, chosen, strict=True))}
            settled = self._settle(Partial(partial.schema, binding, rest))
            if settled is not None:
                yield settled

    def _objects(
        self, condition: Condition, unbound: str, binding: dict[str, str], facts: int
    ) -> list[str]:
        kind = self._table.types[condition.predicate][condition.params.index(unbound)]
        return [
            name
            for name in self._table.by_type[kind]
            if facts & self._table.bit[self._atom(condition, {**binding, unbound: name})]
        ]

    def _enumerate(self, partial: Partial) -> Iterator[Partial]:
        """Where no condition binds a parameter, bind it to every object in turn."""
        unbound = [(n, k) for n, k in partial.schema.parameters if n not in partial.binding]
        if not unbound or self._tested(partial):
            yield partial
            return
        name, kind = unbound[0]
        for thing in self._table.by_type[kind]:
            settled = self._settle(partial._replace(binding={**partial.binding, name: thing}))
            if settled is not None:
                yield from self._enumerate(settled)

    def _atom(self, condition: Condition, binding: dict[str, str]) -> Atom:
        return (condition.predicate, *(binding[name] for name in condition.params))
