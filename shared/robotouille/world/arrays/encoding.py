"""States as vectors of fixed length, and actions as numbers (world.md, "As arrays")."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np
import numpy.typing as npt

from robotouille.errors import UnknownNameError, WrongArgumentError, did_you_mean
from robotouille.world.arrays.graph import Graph, GraphLayout
from robotouille.world.arrays.reachable import Reachable
from robotouille.world.arrays.slots import Names, Slots
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import EXISTS, USED, bits_of
from robotouille.world.grounding.effects import Effect
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, atom_name
from robotouille.world.timers import Timers

__all__ = ["VERSION", "Encoding"]

VERSION = 1
"""Of the layout of vectors and the order of actions. Another one is another order."""

MAX_KEPT = 1_000
"""Sets of created objects for which the places of bits are known; then they are found anew."""

EffectLabel = tuple[str, int, tuple[str, ...]]


class Encoding:
    """How a task's states are vectors, and its actions numbers.

    `objects` are those of the problem and one for each slot; `atoms` those whose truth is in a
    vector, `effects` the special effects whose counters are. All are in a fixed order that depends
    on the task alone (its digest), the slots and `VERSION`.

    Args:
        task: The task; it is given room for the objects that slots are called by.
        slots: How many created objects of a kind there may be at once; see `Slots`.

    Raises:
        RobotouilleError: There are slots for what cannot be created.
    """

    version = VERSION

    def __init__(self, task: GroundTask, slots: Mapping[str, int] | None = None) -> None:
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
        self._bits: dict[tuple[int, tuple[tuple[str, str], ...]], npt.NDArray[np.intp]] = {}

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """What each number of a vector is, in words: `iscut(lettuce1)`, `cook.0(patty1, stove1)`
        (1 if the effect is active), `cook.0(patty1, stove1)[1]` (a counter), `busy(robot1)`."""
        return tuple(self._columns())

    @cached_property
    def high(self) -> int:
        """A number that no number of a vector or graph is above; none is below -1."""
        totals = (node.total for effect in self.effects for node in effect.counters())
        durations = (a.duration for actions in self._actions.values() for a in actions)
        return max(1, *totals, *durations)

    @cached_property
    def _graph(self) -> GraphLayout:
        places: dict[Atom | Effect, int] = {atom: i for i, atom in enumerate(self.atoms)}
        places |= {effect: self._place[effect.label] for effect in self.effects}
        return GraphLayout(self._task, self.objects, places, self._busy, self.size)

    @property
    def features(self) -> tuple[str, ...]:
        """What each number of a graph's node is: `exists`, the types and the predicates of one
        object, as the domain lists them, and `busy`."""
        return self._graph.features

    @property
    def relations(self) -> tuple[str, ...]:
        """What an edge of a graph can be: the domain's predicates of two objects, then its
        special effects, as `cook.0`."""
        return self._graph.relations

    @property
    def counters(self) -> int:
        """How many counters an edge of a graph has."""
        return self._graph.counters

    def _columns(self) -> Iterator[str]:
        yield from map(atom_name, self.atoms)
        for effect in self.effects:
            yield str(effect)
            yield from (f"{effect}[{i}]" for i in range(effect.size))
        yield from (f"busy({player})" for player in self._task.players)

    # Actions

    def ground_actions(self, player: str) -> tuple[GroundAction, ...]:
        """All actions of a player that play could come to, as the domain orders them.

        Those about created objects are about the objects that slots are called by.

        Raises:
            UnknownNameError: There is no such player.
        """
        try:
            return self._actions[player]
        except KeyError:
            players = self._task.players
            raise UnknownNameError(f"no player {player!r}{did_you_mean(player, players)}") from None

    def action(self, facts: int, player: str, number: int) -> GroundAction | None:
        """The action of a number, about the objects that stand in its slots now.

        Returns:
            The action, valid or not; None where a slot that it is about is empty.

        Raises:
            UnknownNameError: There is no such player.
            WrongArgumentError: There is no such number.
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
        """The number of an action in a state: the inverse of `action`.

        Raises:
            UnknownNameError: There is no such player, or play cannot come to such an action.
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
            raise UnknownNameError(f"{action} is none of {player}'s ground actions") from None

    def mask(
        self, facts: int, player: str, valid: tuple[GroundAction, ...]
    ) -> npt.NDArray[np.bool_]:
        """Which of a player's actions are valid, as bits in their order."""
        mask = bytearray(len(self.ground_actions(player)))
        if self.slots.filled(facts):
            for action in valid:
                mask[self.number(facts, player, action)] = 1
        else:
            numbers = self._serials[player]  # twice as fast as by the actions themselves
            for action in valid:
                mask[numbers[action.serial]] = 1
        return np.frombuffer(mask, dtype=np.bool_)

    # States

    def vector(self, facts: int, timers: Timers) -> npt.NDArray[np.float32]:
        """A state as `size` numbers: see `columns`.

        Raises:
            SlotOverflowError: There are more created objects than slots.
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
        return vector

    def graph(self, facts: int, timers: Timers) -> Graph:
        """A state as a graph, which says what `vector` says.

        Raises:
            SlotOverflowError: There are more created objects than slots.
        """
        return self._graph.graph(self.vector(facts, timers))

    def _facts(self, facts: int, names: Names) -> npt.NDArray[np.uint8]:
        count = len(self._task.table.atoms)
        key = count, tuple(names.items())
        places = self._bits.get(key)
        if places is None:
            if len(self._bits) >= MAX_KEPT:
                self._bits.clear()
            places = self._bits[key] = self._places(names)
        packed = np.frombuffer(facts.to_bytes(count // 8 + 1, "little"), dtype=np.uint8)
        return np.unpackbits(packed, bitorder="little")[places]

    def _places(self, names: Names) -> npt.NDArray[np.intp]:
        """The bit of each atom, with the objects that stand in slots; of none, one that is 0."""
        bit = self._task.table.bit
        none = len(self._task.table.atoms)
        renamed = ((p, *(names.get(a, a) for a in arguments)) for p, *arguments in self.atoms)
        return np.array(
            [bit[a].bit_length() - 1 if all(a) else none for a in renamed], dtype=np.intp
        )
