"""States as vectors of fixed length, and actions as numbers (docs/train.md)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np
import numpy.typing as npt

from robotouille.errors import UnknownNameError, WrongArgumentError
from robotouille.world.arrays.graph import Graph, GraphLayout
from robotouille.world.arrays.reachable import Names, Reachable, Slots
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import EXISTS, USED, bits_of
from robotouille.world.grounding.effects import Effect
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, atom_name
from robotouille.world.shift import Orders, ShiftRules
from robotouille.world.timers import Timers

VERSION = 1
"""Version of the layout of vectors and of the order of actions."""

MAX_KEPT = 1_000
"""Largest number of sets of created objects whose bit positions are cached."""

EffectLabel = tuple[str, int, tuple[str, ...]]


class _OrderColumns:
    """Columns of a shift: the steps that are left, and those of each open order under its dish."""

    def __init__(self, shift: ShiftRules, place: int) -> None:
        self._shift = shift
        self.place = place
        self._dishes = {dish: 1 + i for i, dish in enumerate(shift.menu)}
        orders = [f"order{i + 1}({dish})" for i in range(shift.most_open) for dish in shift.menu]
        self.names = ("steps_left", *orders)
        self.high = max(shift.steps, *(map(shift.patience_for, shift.menu)))

    def numbers(self, orders: Orders) -> npt.NDArray[np.float32]:
        numbers = np.zeros(len(self.names), dtype=np.float32)
        numbers[0] = self._shift.steps - orders.time
        for i, order in enumerate(orders.open):
            dish = self._dishes[self._shift.dish_name(order.number)]
            numbers[i * len(self._dishes) + dish] = order.due - orders.time
        return numbers


class Encoding:
    """Encoding of a task's states as vectors and of its actions as numbers.

    The order of everything depends only on the task's digest, the slots and `VERSION`.

    Args:
        task: The task. It gets atoms for the objects after which slots are named.
        slots: Number of created objects of each kind that can exist at once; see `Slots`.
        shift: The rules of the task's shift, if it has one. Its orders are the last columns.

    Attributes:
        objects: The problem's objects, and one object for each slot.
        atoms: The atoms whose truth is in a vector.
        effects: The special effects whose counters are in a vector.

    Raises:
        WrongArgumentError: `slots` is invalid, or has a kind that cannot be created.
    """

    version = VERSION

    def __init__(
        self,
        task: GroundTask,
        slots: Mapping[str, int] | None = None,
        shift: ShiftRules | None = None,
    ) -> None:
        self._task = task
        self.slots = Slots(task, slots)
        reachable = Reachable(task, self.slots)
        self.objects = self.slots.objects()
        self.effects: tuple[Effect, ...] = reachable.effects
        atoms = (task.table.atoms[i] for i in bits_of(reachable.facts))
        self.atoms: tuple[Atom, ...] = tuple(atom for atom in atoms if atom[0] != USED)
        self._actions = {
            player: tuple(a for a in reachable.actions if a.player in (player, None))
            for player in task.players
        }
        self._numbers = {
            player: {action: number for number, action in enumerate(actions)}
            for player, actions in self._actions.items()
        }
        self._serials = {
            player: {action.serial: number for number, action in enumerate(actions)}
            for player, actions in self._actions.items()
        }
        self._place: dict[EffectLabel, int] = {}
        place = len(self.atoms)
        for effect in self.effects:
            self._place[effect.label] = place
            place += 1 + effect.size
        self._busy = {player: place + i for i, player in enumerate(task.players)}
        self.size = place + len(task.players)
        # A graph has no place for orders, which are about no object.
        self._orders = None if shift is None else _OrderColumns(shift, self.size)
        if self._orders is not None:
            self.size += len(self._orders.names)
        self._bits: dict[tuple[int, tuple[tuple[str, str], ...]], npt.NDArray[np.intp]] = {}

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of a vector's numbers.

        Examples are `iscut(lettuce1)`, `cook.0(patty1, stove1)` (1 if the effect is active),
        `cook.0(patty1, stove1)[1]` (a counter) and `busy(robot1)`.
        """
        return tuple(self._columns())

    @cached_property
    def high(self) -> int:
        """Upper bound of the numbers in a vector or graph. The lower bound is -1."""
        totals = (node.total for effect in self.effects for node in effect.counters())
        durations = (a.duration for actions in self._actions.values() for a in actions)
        shift = () if self._orders is None else (self._orders.high,)
        return max(1, *totals, *durations, *shift)

    @cached_property
    def _graph(self) -> GraphLayout:
        places: dict[Atom | Effect, int] = {atom: i for i, atom in enumerate(self.atoms)}
        places |= {effect: self._place[effect.label] for effect in self.effects}
        return GraphLayout(self._task, self.objects, places, self._busy, self.size)

    @property
    def features(self) -> tuple[str, ...]:
        """Names of a graph node's numbers.

        They are `exists`, the domain's types and unary predicates in its order, and `busy`.
        """
        return self._graph.features

    @property
    def relations(self) -> tuple[str, ...]:
        """Kinds of edges in a graph: binary predicates, then effects such as `cook.0`."""
        return self._graph.relations

    @property
    def counters(self) -> int:
        """Number of counters of a graph's edge."""
        return self._graph.counters

    def _columns(self) -> Iterator[str]:
        yield from map(atom_name, self.atoms)
        for effect in self.effects:
            yield str(effect)
            yield from (f"{effect}[{i}]" for i in range(effect.size))
        yield from (f"busy({player})" for player in self._task.players)
        if self._orders is not None:
            yield from self._orders.names

    # Actions

    def ground_actions(self, player: str) -> tuple[GroundAction, ...]:
        """Return all actions of a player that play can reach, in the domain's order.

        Actions with created objects have the objects after which slots are named.

        Raises:
            UnknownNameError: The task has no such player.
        """
        try:
            return self._actions[player]
        except KeyError:
            players = self._task.players
            raise UnknownNameError.player(player, players) from None

    def action(self, facts: int, player: str, number: int) -> GroundAction | None:
        """Return the action of a number, with the objects that fill its slots now.

        Returns:
            The action, valid or not; None if one of its slots is empty.

        Raises:
            UnknownNameError: The task has no such player.
            WrongArgumentError: The player has no such action.
        """
        actions = self.ground_actions(player)
        if not 0 <= number < len(actions):
            raise WrongArgumentError(f"{player} has {len(actions)} actions, found number {number}")
        action = actions[number]
        if self.slots.names.isdisjoint(action.arguments):
            return action
        names = self.slots.filled(facts)
        arguments = tuple(names.get(name, name) for name in action.arguments)
        bit = self._task.table.bit
        for slot, name in zip(action.arguments, arguments, strict=True):
            if slot in self.slots.names and not (name and facts & bit[EXISTS, name]):
                return None
        return (
            action if arguments == action.arguments else self._task.action(action.name, *arguments)
        )

    def number(self, facts: int, player: str, action: GroundAction) -> int:
        """Return the number of an action in a state: the inverse of `action`.

        Raises:
            UnknownNameError: The task has no such player, or play cannot reach the action.
        """
        self.ground_actions(player)
        names = self.slots.filled(facts)
        if names:
            slots = {name: slot for slot, name in names.items() if name}
            if not slots.keys().isdisjoint(action.arguments):
                arguments = tuple(slots.get(name, name) for name in action.arguments)
                action = self._task.action(action.name, *arguments)
        try:
            return self._numbers[player][action]
        except KeyError:
            raise UnknownNameError(f"{player} has no ground action {action}") from None

    def mask(
        self, facts: int, player: str, valid: tuple[GroundAction, ...]
    ) -> npt.NDArray[np.bool_]:
        """Return for each of a player's actions whether it is valid."""
        mask = bytearray(len(self.ground_actions(player)))
        if self.slots.filled(facts):
            for action in valid:
                mask[self.number(facts, player, action)] = 1
        else:
            # Looking up serial numbers is twice as fast as hashing and comparing the actions.
            numbers = self._serials[player]
            for action in valid:
                mask[numbers[action.serial]] = 1
        return np.frombuffer(mask, dtype=np.bool_)

    # States

    def vector(
        self, facts: int, timers: Timers, orders: Orders | None = None
    ) -> npt.NDArray[np.float32]:
        """Return a state as `size` numbers; see `columns`.

        Raises:
            SlotOverflowError: The state has more created objects than slots.
        """
        names = self.slots.filled(facts)
        vector = np.zeros(self.size, dtype=np.float32)
        vector[: len(self.atoms)] = self._facts(facts, names)
        slots = {name: slot for slot, name in names.items() if name}
        for effect, counters in timers.entries:
            action, index, arguments = effect.label
            if slots:
                arguments = tuple(slots.get(name, name) for name in arguments)
            place = self._place[action, index, arguments]
            vector[place] = 1
            vector[place + 1 : place + 1 + effect.size] = counters
        for player, steps in timers.busy:
            vector[self._busy[player]] = steps
        if self._orders is not None and orders is not None:
            vector[self._orders.place :] = self._orders.numbers(orders)
        return vector

    def graph(self, facts: int, timers: Timers, orders: Orders | None = None) -> Graph:
        """Return a state as a graph with the same content as `vector`.

        Raises:
            SlotOverflowError: The state has more created objects than slots.
        """
        return self._graph.graph(self.vector(facts, timers, orders))

    def _facts(self, facts: int, names: Names) -> npt.NDArray[np.uint8]:
        count = len(self._task.table.atoms)
        key = count, tuple(names.items())
        places = self._bits.get(key)
        if places is None:
            if len(self._bits) >= MAX_KEPT:
                self._bits.clear()
            places = self._bits[key] = self._places(names)
        # NumPy unpacks all bits at once; testing each atom's bit in Python takes far longer.
        packed = np.frombuffer(facts.to_bytes(count // 8 + 1, "little"), dtype=np.uint8)
        return np.unpackbits(packed, bitorder="little")[places]

    def _places(self, names: Names) -> npt.NDArray[np.intp]:
        """Return the bit of each atom, with the objects that fill the slots."""
        bit = self._task.table.bit
        # Atoms about empty slots get the bit after the last one, which is always 0.
        none = len(self._task.table.atoms)
        renamed = ((p, *(names.get(a, a) for a in arguments)) for p, *arguments in self.atoms)
        return np.array(
            [bit[a].bit_length() - 1 if all(a) else none for a in renamed], dtype=np.intp
        )
