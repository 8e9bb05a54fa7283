"""The rules of a world in the numbers of its `Encoding`: atoms, objects, effects and actions.

A world's rules are compiled once. `tables` lays them out for kernels; the package
`robotouille-jax` lays them out for JAX.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

from robotouille.domain.schema import GoalTerm
from robotouille.errors import RobotouilleError
from robotouille.world.arrays.encoding import Encoding
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import EXISTS, bits_of
from robotouille.world.grounding.effects import Effect, EffectNode
from robotouille.world.grounding.goal import Goal
from robotouille.world.grounding.objects import Atom, bound
from robotouille.world.world import World


@dataclass(frozen=True, slots=True)
class GoalChoice:
    """Objects, one for each variable, that meet a condition of the goal if all `atoms` hold."""

    objects: tuple[int, ...]
    atoms: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ConditionRule:
    """One condition of the goal: its distinct variables and the choices that can meet it."""

    variables: tuple[int, ...]
    choices: tuple[GoalChoice, ...]


@dataclass(frozen=True, slots=True)
class GoalRule:
    """The goal's conditions in the order in which a search should meet them.

    `kinds` has a number for each variable: two variables with the same number need different
    objects.
    """

    conditions: tuple[ConditionRule, ...]
    kinds: tuple[int, ...]


def goal_rule(
    world: World, goal: Goal, atoms: Mapping[Atom, int], objects: Mapping[str, int]
) -> GoalRule:
    """Return a goal, of a world or of a dish, in the numbers of the world's encoding."""
    identifiers = list(goal.variables)
    kinds = [variable.kind for variable in goal.variables.values()]
    numbers = {identifier: i for i, identifier in enumerate(identifiers)}
    rules = []
    for term in goal.terms:
        distinct = list(dict.fromkeys(term.ids))
        places = [term.ids.index(identifier) for identifier in distinct]
        choices = tuple(
            GoalChoice(tuple(objects[names[place]] for place in places), needed)
            for names, needed in _choices(world, goal, term, atoms)
            if all(name in objects for name in names) and _suits(goal, term, names)
        )
        rules.append(ConditionRule(tuple(numbers[i] for i in distinct), choices))
    initial = {i for atom, i in atoms.items() if world.initial.facts & world.table.bit.get(atom, 0)}
    order = _in_order(rules, initial)
    return GoalRule(tuple(order), tuple(kinds.index(kind) for kind in kinds))


def _choices(
    world: World, goal: Goal, term: GoalTerm, atoms: Mapping[Atom, int]
) -> Iterator[tuple[tuple[str, ...], tuple[int, ...]]]:
    """Yield the names that can meet a condition, with the atoms that have to hold."""
    table = world.table
    if term.predicate not in table.static_predicates:
        for atom in (table.atoms[i] for i in bits_of(goal.possible_mask(term))):
            if atom in atoms:
                yield atom[1:], (atoms[atom],)
        return
    pools = [goal.candidates(identifier) for identifier in term.ids]
    for atom in sorted(a for a in table.static if a[0] == term.predicate):
        if all(name in pool for name, pool in zip(atom[1:], pools, strict=True)):
            # Objects can be deleted, so a static atom holds only while they exist.
            exist = [(EXISTS, name) for name in dict.fromkeys(atom[1:])]
            yield atom[1:], tuple(atoms[e] for e in exist if e in table.bit)


def _suits(goal: Goal, term: GoalTerm, names: tuple[str, ...]) -> bool:
    """Return whether equal ids get one object and different ids of a kind different objects."""
    variables = goal.variables
    for (one, name), (other, taken) in combinations(zip(term.ids, names, strict=True), 2):
        alike = variables[one].kind == variables[other].kind
        if name != taken if one == other else name == taken and alike:
            return False
    return True


def _in_order(rules: list[ConditionRule], initial: set[int]) -> Iterator[ConditionRule]:
    """Order the conditions so that a search fails early.

    Conditions that share a variable with an earlier one come first, because bound variables
    exclude most choices. Ties go to the condition with the fewest choices in the initial state.
    """
    left, bound = list(rules), set[int]()

    def cost(rule: ConditionRule) -> tuple[bool, int, int]:
        new = sum(variable not in bound for variable in rule.variables)
        holding = sum(set(choice.atoms) <= initial for choice in rule.choices)
        return bool(bound) and new == len(rule.variables), holding, new

    while left:
        rule = min(left, key=cost)
        left.remove(rule)
        bound.update(rule.variables)
        yield rule


CONDITIONAL, DELAYED, REPETITIVE, CREATION, DELETION = range(5)
KINDS = ("conditional", "delayed", "repetitive", "creation", "deletion")
"""Kinds of special effects; kernels use their indices."""


def _kind_number(kind: str) -> int:
    if kind not in KINDS:
        raise RobotouilleError(
            f"batch worlds do not support special effects of kind {kind!r}; "
            "add it to KINDS and to step_kernels.py"
        )
    return KINDS.index(kind)


@dataclass(frozen=True, slots=True)
class ActionRule:
    """A ground action, valid if all `required` atoms are true and no `forbidden` atom is.

    The action makes `clears` false and `sets` true and starts `effects` in this order. It keeps
    its player busy for `duration` steps; 0 stands for one step. An action that is not `possible`
    is never valid.
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
    """Result of a creation or deletion: changed atoms, and effects that it starts (`born`)."""

    sets: tuple[int, ...]
    clears: tuple[int, ...]
    born: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class NodeRule:
    """A node of a special effect; the nodes nested in it follow, up to `end`.

    `kind` is an index into `KINDS`. `subject` is the object that a deletion deletes. `creates` is
    the kind that a creation creates, as an index into `CompiledRules.kinds`. `outcomes` has one
    entry for a deletion, and one for each slot for a creation.
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
    """A special effect: its nodes are `first` up to `end`.

    The effect ends when one of its `objects` is deleted.
    """

    first: int
    end: int
    objects: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Shift:
    """Source of each atom's and effect's value after a slot has become empty.

    Objects in later slots move up by one. -1 stands for false or inactive.
    """

    atoms: tuple[int, ...]
    effects: tuple[int, ...]


def refuse_shift(world: World) -> None:
    """Check that a world has a goal.

    Raises:
        RobotouilleError: It has a shift, which kernels cannot play.
    """
    if world.shift is not None:
        raise RobotouilleError(
            "the batch engine does not support shifts; use the environments, World.step or JaxBatch"
        )


class CompiledRules:
    """The rules of a world in the numbers of its encoding.

    Args:
        world: The world to compile.
        slots: Number of created objects of each kind that can exist at once; see `Slots` for the
            default.

    Attributes:
        nodes: Nodes of all effects. A node's index is also the index of its counter.
        kinds: Kinds of objects that have slots.
        exists: For each of `kinds`, the atom of each slot; empty if play cannot reach the kind.
    """

    def __init__(self, world: World, slots: Mapping[str, int] | None = None) -> None:
        self.world = world
        self.encoding = world.encoding if slots is None else Encoding(world, slots, world.shift)
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
        self.goal: GoalRule = goal_rule(world, world.goal, self.atom, self.object)

    def atoms_of(self, mask: int) -> tuple[int, ...]:
        """Return the atoms of a mask of facts, without atoms that play cannot reach."""
        index = self._index
        return tuple(index[i] for i in bits_of(mask) if i in index)

    def effect_number(self, label: tuple[str, int, tuple[str, ...]]) -> int:
        """Return the number of an effect whose label names created objects by their slots."""
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
            kind=_kind_number(node.kind),
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
        """For each kind and slot, how values move after the slot has become empty.

        It is empty if play cannot delete created objects. Most domains cannot, and the lists are
        as long as the number of slots times the number of atoms.
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
