"""Actions with some parameters bound: what to test next, and what follows from what is true.

A condition that is bound is tested; one that lacks a single parameter binds it to what is true of
an object that is bound already, or, only where there is no such condition, to what is true of
anything. Everything that does not depend on a state is worked out once for each binding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

from robotouille.domain.schema import Condition
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS, AtomTable
from robotouille.world.grounding.objects import bound

__all__ = ["PartialAction", "PartialActions"]

Binding = dict[str, str]
Pool = tuple[tuple[int, tuple[str]], ...]
"""The objects that a parameter may be bound to, each with the atoms that must be true for it."""


class PartialActions:
    """Makes the partial actions of a player from a table of atoms."""

    def __init__(
        self,
        table: AtomTable,
        ground: Callable[[ActionSchema, tuple[str, ...]], GroundAction],
    ) -> None:
        self.table = table
        self.ground = ground

    def begin(self, schema: ActionSchema, player: str) -> PartialAction | None:
        """An action of which the player alone is bound; None if static facts rule it out."""
        binding = {schema.parameters[0][0]: player} if schema.player else {}
        existence = tuple(
            Condition.model_construct(predicate=EXISTS, params=(name,), is_true=True)
            for name, kind in schema.parameters
            if kind in self.table.transient
        )
        return self.make(schema, binding, schema.definition.precons + existence, player)

    def make(
        self,
        schema: ActionSchema,
        binding: Binding,
        conditions: tuple[Condition, ...],
        player: str,
    ) -> PartialAction | None:
        """With the static conditions decided that are fully bound; None where one is violated."""
        still_open = []
        for condition in conditions:
            fluent = condition.predicate not in self.table.static_predicates
            if fluent or any(name not in binding for name in condition.params):
                still_open.append(condition)
            elif (bound(condition, binding) in self.table.static) != condition.is_true:
                return None
        return PartialAction(self, schema, binding, tuple(still_open), player)


class PartialAction:
    """An action schema with some parameters bound, and its conditions yet to be tested.

    `mask` has the atoms that are tested next. `is_settled`: there is no condition left;
    `is_local`: the next test concerns an object that is bound already, other than the player.
    """

    __slots__ = (
        "_binding", "_next", "_player", "_pools", "_required", "_rest", "_source", "_tested",
        "expansion", "ground", "is_local", "is_settled", "mask", "schema",
    )  # fmt: skip

    def __init__(
        self,
        source: PartialActions,
        schema: ActionSchema,
        binding: Binding,
        conditions: tuple[Condition, ...],
        player: str,
    ) -> None:
        self.schema = schema
        self._source = source
        self._binding = binding
        self._player = player
        self.ground: GroundAction | None = None
        self.expansion: tuple[PartialAction, ...] | None = None
        self._next: dict[tuple[str, ...], tuple[PartialAction, ...]] = {}
        tested = _tested(conditions, binding, source.table)
        # By identity: conditions are compared slowly, and these come from `conditions`.
        chosen = {id(condition) for condition in tested}
        self._rest = tuple(c for c in conditions if id(c) not in chosen)
        self.is_settled = not conditions
        self.is_local = any(
            name in binding and binding[name] != player for c in tested for name in c.params
        )
        self._compile(tested)

    def _compile(self, tested: list[Condition]) -> None:
        table, binding = self._source.table, self._binding
        required = forbidden = self.mask = 0
        pools: dict[str, dict[str, int]] = {}
        for condition in tested:
            unbound = next((name for name in condition.params if name not in binding), None)
            if unbound is None:
                bit = table.bit[bound(condition, binding)]
                self.mask |= bit
                if condition.is_true:
                    required |= bit
                else:
                    forbidden |= bit
                continue
            kind = table.types[condition.predicate][condition.params.index(unbound)]
            bits = {
                name: table.bit[bound(condition, {**binding, unbound: name})]
                for name in table.by_type[kind]
            }
            for bit in bits.values():
                self.mask |= bit
            known = pools.get(unbound)
            if known is not None:
                bits = {n: known[n] | bit for n, bit in bits.items() if n in known}
            pools[unbound] = bits
        self._tested, self._required = required | forbidden, required
        if required & forbidden:
            self._tested, self._required = 0, 1
        self._pools: dict[str, Pool] = {
            name: tuple((bit, (thing,)) for thing, bit in bits.items())
            for name, bits in pools.items()
        }

    def advance(self, facts: int) -> Sequence[PartialAction]:
        """What remains possible in `facts` once the next conditions are tested."""
        if self.is_settled:
            return (self,)
        if facts & self._tested != self._required:
            return ()
        if len(self._pools) == 1:
            return self._advance_one(facts)
        chosen = [
            [name for bits, (name,) in pool if facts & bits == bits]
            for pool in self._pools.values()
        ]
        found: list[PartialAction] = []
        for names in product(*chosen):
            following = self._next.get(names)
            found += self._follow(names) if following is None else following
        return found

    def _advance_one(self, facts: int) -> list[PartialAction]:
        """The usual case, in which one parameter is bound next."""
        (pool,) = self._pools.values()
        found: list[PartialAction] = []
        for bits, names in pool:
            if facts & bits == bits:
                following = self._next.get(names)
                found += self._follow(names) if following is None else following
        return found

    def _follow(self, names: tuple[str, ...]) -> tuple[PartialAction, ...]:
        binding = {**self._binding, **dict(zip(self._pools, names, strict=True))}
        child = self._source.make(self.schema, binding, self._rest, self._player)
        following = self._next[names] = () if child is None else (child,)
        return following

    def expand(self) -> tuple[PartialAction, ...]:
        """Itself; where no condition binds a parameter, itself for every object in turn.

        `expansion` is the answer, once it has been asked for.
        """
        self.expansion = self._expand()
        return self.expansion

    def _expand(self) -> tuple[PartialAction, ...]:
        unbound = [(n, k) for n, k in self.schema.parameters if n not in self._binding]
        if not unbound or self._required or self._tested or self._pools:
            return (self,) if self.mask or not unbound else ()
        name, kind = unbound[0]
        found: tuple[PartialAction, ...] = ()
        for thing in self._source.table.by_type[kind]:
            binding = {**self._binding, name: thing}
            child = self._source.make(self.schema, binding, self._rest, self._player)
            if child is not None:
                found += child.expand()
        return found

    def make_ground(self) -> GroundAction:
        """The ground action, if all parameters are bound; afterwards it is `ground`."""
        names = tuple(self._binding[name] for name, _ in self.schema.parameters)
        self.ground = self._source.ground(self.schema, names)
        return self.ground


def _tested(
    conditions: tuple[Condition, ...], binding: Binding, table: AtomTable
) -> list[Condition]:
    """The conditions tested next: all that are bound, and those that bind one parameter."""
    settled, binding_ones = [], []
    for condition in conditions:
        if condition.predicate in table.static_predicates:
            continue
        free = {name for name in condition.params if name not in binding}
        if not free:
            settled.append(condition)
        elif len(free) == 1 and condition.is_true and condition.predicate != EXISTS:
            binding_ones.append(condition)
    near = [c for c in binding_ones if any(name in binding for name in c.params)]
    return settled + (near or binding_ones[:1])
