"""What a step does, over numbers: atoms, objects, effects and actions of an `Encoding`.

`Rules` are compiled from a world once. `tables` lays them out for kernels, `padded` for JAX.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from robotouille.batch.goal_rule import GoalRule, goal_rule
from robotouille.world.arrays.encoding import Encoding
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import EXISTS, bits_of
from robotouille.world.grounding.effects import Effect, EffectNode
from robotouille.world.grounding.objects import bound
from robotouille.world.world import World

__all__ = [
    "CONDITIONAL",
    "CREATION",
    "DELAYED",
    "DELETION",
    "REPETITIVE",
    "ActionRule",
    "EffectOutcome",
    "EffectRule",
    "NodeRule",
    "Rules",
    "Shift",
]

CONDITIONAL, DELAYED, REPETITIVE, CREATION, DELETION = range(5)
KINDS = ("conditional", "delayed", "repetitive", "creation", "deletion")


@dataclass(frozen=True, slots=True)
class ActionRule:
    """A ground action: it applies where all of `required` hold and none of `forbidden`, if that is
    `possible` at all.

    It makes `clears` false and `sets` true, starts `effects` in this order, and keeps its player
    busy for `duration` steps, where that is more than one.
    """

    possible: bool
    required: tuple[int, ...]
    forbidden: tuple[int, ...]
    sets: tuple[int, ...]
    clears: tuple[int, ...]
    effects: tuple[int, ...]
    duration: int


@dataclass(frozen=True, slots=True)
class EffectOutcome:
    """What an effect does when it creates or deletes: atoms, and the effects it starts."""

    sets: tuple[int, ...]
    clears: tuple[int, ...]
    born: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class NodeRule:
    """A node of a special effect. Those nested in it follow it, up to `end`.

    `kind` is the place in `KINDS`. `subject` is what a deletion deletes, `creates` the place of the
    kind that a creation creates, and `outcomes` has what that does: a creation's in each slot.
    """

    kind: int
    end: int
    total: int
    possible: bool
    required: tuple[int, ...]
    forbidden: tuple[int, ...]
    sets: tuple[int, ...]
    clears: tuple[int, ...]
    subject: int = -1
    creates: int = -1
    outcomes: tuple[EffectOutcome, ...] = ()


@dataclass(frozen=True, slots=True)
class EffectRule:
    """A special effect: its nodes are `first` up to `end`; it ends with any of its `objects`."""

    first: int
    end: int
    objects: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Shift:
    """What moves up when the object in a slot has gone: where each atom and effect comes from.

    What comes from nowhere, -1, is false or inactive.
    """

    atoms: tuple[int, ...]
    effects: tuple[int, ...]


class Rules:
    """The rules of a world, in the numbers of its encoding.

    `nodes` are those of all effects; a node's number is also its counter's. `kinds` are the kinds
    of objects that have slots, and `exists` the atom of each slot of each; those of a kind that
    play cannot come to have none.

    Args:
        world: Whose rules they are.
        slots: How many created objects of a kind there may be at once, if not as many as usually.
    """

    def __init__(self, world: World, slots: Mapping[str, int] | None = None) -> None:
        self.world = world
        self.encoding = world.encoding if slots is None else Encoding(world, slots)
        self.players = world.players
        table = world.table
        self.atom = {atom: i for i, atom in enumerate(self.encoding.atoms)}
        self._index = {table.bit[a].bit_length() - 1: i for a, i in self.atom.items()}
        self.object = {thing.name: i for i, thing in enumerate(self.encoding.objects)}
        self._effect = {effect.label: i for i, effect in enumerate(self.encoding.effects)}
        self.kinds = tuple(self.encoding.slots.by_kind)
        self.slots = tuple(self.encoding.slots.by_kind.values())
        self.exists = tuple(
            tuple(self.atom[EXISTS, name] for name in names if (EXISTS, name) in self.atom)
            for names in self.slots
        )
        self.mentions = tuple(self.atoms_of(table.mentions(name)) for name in self.object)
        self.nodes: list[NodeRule] = []
        self.effects = tuple(self._effect_rule(effect) for effect in self.encoding.effects)
        self.actions = tuple(
            tuple(self._action_rule(a) for a in self.encoding.ground_actions(player))
            for player in self.players
        )
        self.goal: GoalRule = goal_rule(world, self.atom, self.object)

    def atoms_of(self, mask: int) -> tuple[int, ...]:
        """The atoms of a mask of the world's; those that play cannot come to are left out."""
        index = self._index
        return tuple(index[i] for i in bits_of(mask) if i in index)

    def effect_number(self, label: tuple[str, int, tuple[str, ...]]) -> int:
        """The number of the effect of a label, about what slots are called by."""
        return self._effect[label]

    def _effects_of(self, effects: Iterable[Effect]) -> tuple[int, ...]:
        return tuple(self._effect[effect.label] for effect in effects)

    def _action_rule(self, action: GroundAction) -> ActionRule:
        return ActionRule(
            possible=not action.required & ~action.tested,
            required=self.atoms_of(action.required),
            forbidden=self.atoms_of(action.tested & ~action.required),
            sets=self.atoms_of(action.touched & ~action.removed),
            clears=self.atoms_of(action.removed),
            effects=self._effects_of(action.effects),
            duration=action.duration if action.player is not None and action.duration > 1 else 0,
        )

    def _effect_rule(self, effect: Effect) -> EffectRule:
        first = len(self.nodes)
        self.nodes += self._node_rules(effect.root, first)
        objects = tuple(self.object[name] for name in sorted(set(effect.label[2])))
        return EffectRule(first, len(self.nodes), objects)

    def _node_rules(self, node: EffectNode, place: int) -> list[NodeRule]:
        nested: list[NodeRule] = []
        for child in node.nested:
            nested += self._node_rules(child, place + 1 + len(nested))
        required = self.atoms_of(node.required)
        rule = NodeRule(
            kind=KINDS.index(node.kind),
            end=place + 1 + len(nested),
            total=node.total,
            possible=node.possible and len(required) == node.required.bit_count(),
            required=required,
            forbidden=self.atoms_of(node.tested & ~node.required),
            sets=self.atoms_of(node.sets),
            clears=self.atoms_of(node.clears),
            subject=self.object[node.subject] if node.kind == "deletion" else -1,
            creates=self.kinds.index(node.created.name) if node.created else -1,
            outcomes=tuple(self._outcomes(node)),
        )
        return [rule, *nested]

    def _outcomes(self, node: EffectNode) -> Iterator[EffectOutcome]:
        if node.kind == "deletion":
            yield EffectOutcome((), (), self._born(node, dict(node.binding)))
        if node.created is None:
            return
        mask = self.world.table.mask
        for name in self.slots[self.kinds.index(node.created.name)]:
            binding = {**dict(node.binding), node.created.param: name}
            sets = mask([(EXISTS, name), *(bound(c, binding) for c in node.fx if c.is_true)])
            clears = mask(bound(c, binding) for c in node.fx if not c.is_true)
            born = self._born(node, binding)
            yield EffectOutcome(self.atoms_of(sets), self.atoms_of(clears & ~sets), born)

    def _born(self, node: EffectNode, binding: dict[str, str]) -> tuple[int, ...]:
        return self._effects_of(self.world.born_effect(effect, binding) for effect in node.sfx)

    @cached_property
    def shifts(self) -> tuple[tuple[Shift, ...], ...]:
        """For each kind and slot, what moves when the object in it has gone.

        Empty where play deletes nothing that stands in slots.
        """
        in_slots = {self.object[name] for names in self.slots for name in names}
        if not any(node.subject in in_slots for node in self.nodes):
            return ()
        return tuple(
            tuple(self._shift(names, gone) for gone in range(len(atoms)))
            for names, atoms in zip(self.slots, self.exists, strict=True)
        )

    def _shift(self, names: tuple[str, ...], gone: int) -> Shift:
        comes_from = dict(zip(names[gone:], (*names[gone + 1 :], ""), strict=True))

        def renamed(arguments: Iterable[str]) -> tuple[str, ...]:
            return tuple(comes_from.get(name, name) for name in arguments)

        atoms = ((p, *renamed(arguments)) for p, *arguments in self.encoding.atoms)
        labels = (effect.label for effect in self.encoding.effects)
        return Shift(
            tuple(self.atom.get(atom, -1) for atom in atoms),
            tuple(self._effect.get((a, i, renamed(names)), -1) for a, i, names in labels),
        )
