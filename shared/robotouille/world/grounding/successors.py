"""Which actions apply: a decision tree for each player, grown where play goes.

A node tests some atoms at once: `facts & mask` selects a child. At the root these are the atoms
about the player (its place, its hand); below, those about what it has at hand. Parameters are
bound by the atoms that are true, so no action is ever made that could not apply there, and
listing the valid actions of a state takes a handful of dictionary look-ups.

Where many players move there are more combinations of what a node tests than are ever met again,
so growing has to be fast, too: what an action with some parameters bound tests next, and to what
that leads, is worked out once (`PartialAction`), and a new node asks that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter

from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import AtomTable
from robotouille.world.grounding.partial_actions import PartialAction, PartialActions

__all__ = ["SuccessorTree"]

_KEY = attrgetter("key")

MAX_NODES = 40_000
"""Of one player's tree; then it grows anew."""


class DecisionNode:
    """Tests `mask`; a leaf (mask 0) lists the actions that apply."""

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
        """Split into parts whose tests concern the same objects, in the domain's order.

        What a place holds is tested together; which places are vacant, apart from it: else the
        number of nodes would be the product of both. Parts whose schemas interleave are joined,
        so that listing them one after the other keeps the order.
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
