"""The valid actions of a state: a decision tree for each player, grown on demand.

A node tests several atoms at once: `facts & mask` selects a child. The root tests the atoms about
the player, such as its place and its hand. Deeper nodes test the atoms about objects bound so
far. True atoms bind the parameters, so only actions that can be valid are made. Listing a state's
valid actions takes a few dictionary lookups; see docs/decisions/0001-lazy-successor-trees.md.

With many players, most combinations of tested atoms occur only once, so growing a node must also
be fast. A `PartialAction` therefore caches what it tests next and where each result leads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from operator import attrgetter

from robotouille.domain.schema import Condition
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS, AtomTable
from robotouille.world.grounding.objects import bound

Binding = dict[str, str]
Pool = tuple[tuple[int, tuple[str]], ...]
"""Objects to which a parameter can be bound, with the atoms that must be true for each."""


class PartialActions:
    """Factory of a player's partial actions."""

    def __init__(
        self,
        table: AtomTable,
        ground: Callable[[ActionSchema, tuple[str, ...]], GroundAction],
    ) -> None:
        self.table = table
        self.ground = ground

    def begin(self, schema: ActionSchema, player: str) -> PartialAction | None:
        """Bind only the player of an action; return None if static facts rule it out."""
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
        """Decide the static conditions that are fully bound; return None if one is violated."""
        still_open = []
        for condition in conditions:
            fluent = condition.predicate not in self.table.static_predicates
            if fluent or any(name not in binding for name in condition.params):
                still_open.append(condition)
            elif (bound(condition, binding) in self.table.static) != condition.is_true:
                return None
        return PartialAction(self, schema, binding, tuple(still_open), player)


class PartialAction:
    """An action schema with some parameters bound, and its untested conditions.

    Attributes:
        mask: The atoms that are tested next.
        is_settled: True if no condition is left.
        is_local: True if the next test mentions a bound object other than the player.
        expansion: Result of `expand`, once computed.
        ground: Result of `make_ground`, once computed.
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
        # Compared by identity, because comparing conditions is slow.
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
        """Test the next conditions and return the partial actions that remain possible."""
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
        """Advance if exactly one parameter is bound next, which is the usual case."""
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
        """Return this partial action, or one for each object if no condition binds a parameter."""
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
        """Return the ground action; all parameters must be bound."""
        names = tuple(self._binding[name] for name, _ in self.schema.parameters)
        self.ground = self._source.ground(self.schema, names)
        return self.ground


def _tested(
    conditions: tuple[Condition, ...], binding: Binding, table: AtomTable
) -> list[Condition]:
    """Return the next conditions to test: bound ones, and ones that bind one parameter."""
    settled, binding_ones = [], []
    for condition in conditions:
        if condition.predicate in table.static_predicates:
            continue
        free = {name for name in condition.params if name not in binding}
        if not free:
            settled.append(condition)
        elif len(free) == 1 and condition.is_true and condition.predicate != EXISTS:
            binding_ones.append(condition)
    # Conditions about a bound object leave few choices; without any, one condition is enough.
    near = [c for c in binding_ones if any(name in binding for name in c.params)]
    return settled + (near or binding_ones[:1])


_KEY = attrgetter("key")

MAX_NODES = 40_000
"""Limit on the nodes of one player's tree. A full tree is discarded."""


class DecisionNode:
    """Node that tests the atoms in `mask`, or a leaf (mask 0) that lists valid actions."""

    __slots__ = ("actions", "children", "mask", "partials")

    def __init__(
        self,
        mask: int,
        partials: tuple[PartialAction, ...],
        actions: tuple[GroundAction, ...],
    ) -> None:
        self.mask = mask
        self.partials = partials
        self.actions = actions
        self.children: dict[int, DecisionNode] = {}


class SuccessorTree:
    """Decision tree that finds one player's valid actions in a state."""

    def __init__(
        self,
        player: str,
        kind: str,
        schemas: tuple[ActionSchema, ...],
        table: AtomTable,
        ground: Callable[[ActionSchema, tuple[str, ...]], GroundAction],
    ) -> None:
        self._player = player
        self._schemas = tuple(s for s in schemas if not s.player or s.parameters[0][1] == kind)
        self._source = PartialActions(table, ground)
        self._buckets: dict[int, tuple[DecisionNode, ...]] = {}
        self._size = 0
        self._start = self._begin()
        self._root_mask = 0
        for partial in self._start:
            self._root_mask |= partial.mask

    def _begin(self) -> tuple[PartialAction, ...]:
        begun = (self._source.begin(schema, self._player) for schema in self._schemas)
        return tuple(partial for partial in begun if partial is not None)

    def actions(self, facts: int) -> tuple[GroundAction, ...]:
        """Return the valid actions in the domain's order."""
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
        """Discard the tree."""
        self._buckets.clear()
        self._size = 0
        self._start = self._begin()

    def _new_bucket(self, facts: int) -> tuple[DecisionNode, ...]:
        partials = [p for start in self._start for p in start.advance(facts)]
        bucket = tuple(self._node(group) for group in self._groups(partials))
        self._buckets[facts & self._root_mask] = bucket
        return bucket

    def _new_child(self, node: DecisionNode, facts: int) -> DecisionNode:
        advanced = [p for partial in node.partials for p in partial.advance(facts)]
        child = node.children[facts & node.mask] = self._node(advanced)
        return child

    def _node(self, partials: list[PartialAction]) -> DecisionNode:
        if self._size >= MAX_NODES:
            self.forget()
        self._size += 1
        found: list[PartialAction] = []
        for partial in partials:
            expansion = partial.expansion
            found += partial.expand() if expansion is None else expansion
        mask = 0
        for partial in found:
            mask |= partial.mask
        if mask:
            return DecisionNode(mask, tuple(found), ())
        actions = [partial.ground or partial.make_ground() for partial in found]
        return DecisionNode(0, (), tuple(sorted(actions, key=_KEY)))

    def _groups(self, partials: list[PartialAction]) -> Iterator[list[PartialAction]]:
        """Split partial actions into groups with their own trees, in the domain's order.

        Tests about the objects at hand and tests about vacant places are separated; one tree for
        both would have the product of their nodes. Groups whose schemas interleave are joined, so
        that concatenating their actions keeps the domain's order.
        """
        groups: list[list[PartialAction]] = []
        for partial in sorted(partials, key=lambda p: p.schema.index):
            if groups and (
                groups[-1][-1].schema is partial.schema
                or partial.is_settled
                or groups[-1][-1].is_local == partial.is_local
            ):
                groups[-1].append(partial)
            else:
                groups.append([partial])
        return iter(groups)
