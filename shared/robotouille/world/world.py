"""The Markov decision process of a task: states, valid actions, steps (paper, section 2).

world = World(load_task("synchronous/01_cheese_sandwich"))
state = world.initial
state = state.step(state.actions("robot1")[0]).state

`World` and `State` are the two halves of one thing, so they are in one module: a state asks its
world, and a world answers with states. What each can say without the other is below:
`GroundState` and `GroundTask`; and what they are computed from: `Timers`, `SuccessorTree`.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from robotouille.domain.loading import load_task
from robotouille.domain.task import Task
from robotouille.errors import (
    InapplicableError,
    MissingExtraError,
    RobotouilleError,
    UnknownNameError,
    WrongArgumentError,
    WrongWorldError,
    did_you_mean,
)
from robotouille.world.arrays.packing import PackedState, packed, unpacked
from robotouille.world.ground_state import GroundState
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.ground_objects import MAX_CREATED
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, atom_name
from robotouille.world.grounding.successors import SuccessorTree
from robotouille.world.joint_action import JointAction, in_order, not_an_action, read
from robotouille.world.sentences import known, no_valid_action, said, said_exactly
from robotouille.world.text import goal_sentences, observation, text_view
from robotouille.world.timers import BusyRow, TimerRow, Timers, TimerTable
from robotouille.world.unmet import Attempt, Unmet, acted_already, unmet_in

if TYPE_CHECKING:
    from numpy import bool_, float32
    from numpy.typing import NDArray

    from robotouille.world.arrays.encoding import Encoding
    from robotouille.world.arrays.graph import Graph

__all__ = ["State", "Step", "World", "shared_world"]


class State(GroundState):
    """`s = (facts, timers)` of the paper's section 2.

    Immutable, hashable and cheap to keep: an integer and a shared tuple. `pickle` and `copy` work;
    states are equal when their facts and timers are.
    """

    __slots__ = ()

    world: World

    def __init__(self, world: World, facts: int, timers: Timers) -> None:
        self.world = world
        self.facts = facts
        self.timers = timers

    def __repr__(self) -> str:
        return f"<State of {self.world.task.name} {self.digest}>"

    def __copy__(self) -> State:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> State:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self.world, self.facts, self.timer_rows(), self.timers.busy)

    def actions(self, player: str) -> tuple[GroundAction, ...]:
        """The valid actions of a player in a stable order: as in the domain, then by object.

        There are none while the player is busy.

        Raises:
            UnknownNameError: There is no such player.
        """
        return self.world.actions(self, player)

    def step(self, actions: JointAction) -> Step:
        """Take a joint action, and let a step of time pass.

        Args:
            actions: A `GroundAction`, the sentence of a valid one, a list of these in the order in
                which they apply (None does nothing), or a dict of them by player.

        Returns:
            The new state, and which actions were applied or rejected: see `World.step`.

        Raises:
            UnknownNameError: A sentence is that of no valid action, or there is no such player.
            WrongArgumentError: Something is no action at all.
            WrongWorldError: An action is one of another task.
        """
        return self.world.step(self, actions)

    def mask(self, player: str) -> NDArray[bool_]:
        """Which of `World.ground_actions(player)` are valid: an array of booleans.

        Raises:
            UnknownNameError: There is no such player.
            SlotOverflowError: There are more created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.mask(self.facts, player, self.actions(player))

    def vector(self) -> NDArray[float32]:
        """The state as numbers, as many for each state of the task (world.md, "As arrays").

        Raises:
            SlotOverflowError: There are more created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.vector(self.facts, self.timers)

    def without(self, atoms: Iterable[Atom]) -> State:
        """The same state in which some facts do not hold any more. What runs goes on.

        Args:
            atoms: As `atoms` gives them; those that do not hold anyway do not matter.

        Raises:
            UnknownNameError: An atom is none of this world.
        """
        facts, bits = self.facts, self.world.table.bit
        for atom in atoms:
            if atom not in bits:
                raise UnknownNameError(f"there is no fact {atom_name(atom)}")
            facts &= ~bits[atom]
        return State(self.world, facts, self.timers)

    def graph(self) -> Graph:
        """The state as a graph of objects and relations, as arrays (world.md, "As arrays").

        Raises:
            SlotOverflowError: There are more created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.graph(self.facts, self.timers)

    def action(self, player: str, number: int) -> GroundAction | None:
        """The action of a number: that in its place in `World.ground_actions(player)`, about the
        objects that stand in its slots now.

        Returns:
            The action, valid or not; None where a slot that it is about is empty.

        Raises:
            UnknownNameError: There is no such player.
            WrongArgumentError: There is no such number.
            SlotOverflowError: There are more created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.action(self.facts, player, number)

    def action_number(self, action: GroundAction, player: str | None = None) -> int:
        """The number of an action: the inverse of `action`.

        Args:
            action: One of this world, or of another world of the same task.
            player: Whose number it is to be; the acting player's if None.

        Raises:
            UnknownNameError: Play cannot come to such an action, or there is no such player.
            SlotOverflowError: There are more created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        whose = player or action.player or self.world.players[0]
        return self.world.encoding.number(self.facts, whose, action)

    def text(self, player: str | None = None) -> str:
        """The observation in words (world.md, "In words").

        Args:
            player: Whose valid actions are listed at its end; the first player's if None.

        Raises:
            UnknownNameError: There is no such player.
        """
        return observation(self.world, self.facts, self.actions(player or self.world.players[0]))

    def text_view(self, player: str | None = None) -> str:
        """What an agent that reads is sent (world.md, "In words"): who it is, then `text`, then
        `World.goal_terms`.

        Args:
            player: Who the agent is; None for one that only watches.

        Raises:
            UnknownNameError: There is no such player.
        """
        return text_view(self.text(player), player, self.world.goal_terms(self))


def _restore(
    world: World,
    facts: int,
    rows: tuple[TimerRow, ...],
    busy: tuple[BusyRow, ...],
) -> State:
    return world.restore(facts, rows, busy)


class Step(NamedTuple):
    """The result of a step: the new state, its reward and what became of each action."""

    state: State
    attempts: tuple[Attempt, ...]
    goal_reached: bool

    @property
    def reward(self) -> float:
        """1 on a step that reaches the goal, else 0."""
        return 1.0 if self.goal_reached else 0.0


class World(GroundTask):
    """A grounded task: what its states, valid actions and steps are.

    `task` is what it was made of, `players` the names of its players, in the order of their seats.

    No course of play is in it, so all courses of a task may share one. But it grows while it is
    used, so it is for one thread at a time; a program with several has one for each. What grows:

    - Objects and atoms, by generations (see `GroundObjects`), and only by `make_room`,
      `make_room_for_another` and `admit`, or where a step creates, or `restore` needs, more
      objects than there is room for, which comes to the same. No bit moves, so states, actions
      and timers stay good; the successor trees and what the goal knows are begun anew.
    - Ground actions and effects, made when first needed; they live as long as the world.
    - What it remembers of its answers: successor trees (at most `successors.MAX_NODES` nodes a
      player), transitions of timers (`timers.MAX_KEPT`), parts of states in which the goal holds
      (`goal.MAX_KEPT`). At the bound it forgets and learns anew; answers never change by it.

    Args:
        task: A task, or a name or path for `load_task`.
        slots: For how many created objects of a kind arrays have room, where the usual number
            will not do (world.md, "As arrays").

    Raises:
        UnknownTaskError: No task and no file goes by that name.
        FileError: The task's files are wrong.
    """

    def __init__(self, task: Task | str, *, slots: Mapping[str, int] | None = None) -> None:
        super().__init__(task if isinstance(task, Task) else load_task(task))
        self._slots = tuple(sorted((slots or {}).items()))
        self.timers = TimerTable(self)
        self._trees: dict[str, SuccessorTree] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        task, slots = self.task, (dict(self._slots),) if self._slots else ()
        if self._is_shipped:
            return _shipped_world, (task.name, task.seats, task.timing.value, task.digest, *slots)
        return shared_world, (task, *slots)

    def __copy__(self) -> World:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> World:
        return self

    def _grown(self) -> None:
        super()._grown()
        self._trees.clear()

    @cached_property
    def _is_shipped(self) -> bool:
        """Whether the task can be loaded by its name, so that it need not travel with states."""
        task = self.task
        try:
            known = load_task(task.name, seats=task.seats, timing=task.timing, files=False)
        except RobotouilleError:
            return False
        return known.digest == task.digest

    @cached_property
    def initial(self) -> State:
        """The state in which every episode of the task begins."""
        return State(self, self.initial_facts, self.timers.none)

    @cached_property
    def _goal_sentences(self) -> tuple[str, ...]:
        return goal_sentences(self)

    def goal_terms(self, state: State) -> tuple[tuple[str, bool], ...]:
        """Every condition of the goal in words, and whether it holds in a state of this world.

        They are in the problem's order, and none is left out. One holds if some choice of objects
        makes it true together with all before it that hold; so all of them hold exactly where the
        goal is reached.
        """
        return tuple(zip(self._goal_sentences, self.goal.holding(state.facts), strict=True))

    # Arrays

    @cached_property
    def encoding(self) -> Encoding:
        """How states are vectors and graphs, and actions numbers (world.md, "As arrays").

        Raises:
            RobotouilleError: The world was given slots for what cannot be created.
            MissingExtraError: NumPy is not installed.
        """
        try:
            from robotouille.world.arrays.encoding import Encoding
        except ImportError:
            raise MissingExtraError("states as arrays", "rl") from None
        return Encoding(self, dict(self._slots))

    def ground_actions(self, player: str) -> tuple[GroundAction, ...]:
        """All actions of a player that play could come to, in a fixed order.

        Raises:
            UnknownNameError: There is no such player.
            MissingExtraError: NumPy is not installed.
        """
        return self.encoding.ground_actions(player)

    # Actions

    def actions(self, state: State, player: str) -> tuple[GroundAction, ...]:
        """The valid actions of a player in a stable order; none while the player is busy.

        Raises:
            UnknownNameError: There is no such player.
        """
        try:
            tree = self._trees[player]
        except (KeyError, TypeError):
            tree = self._new_tree(player)
        if state.timers.busy and state.timers.busy_steps(player):
            return ()
        return tree.actions(state.facts)

    def _new_tree(self, player: str) -> SuccessorTree:
        if player not in self.players:
            raise UnknownNameError(f"no player {player!r}{did_you_mean(player, self.players)}")
        kind = self._things[player].type
        tree = SuccessorTree(player, kind, self.schemas, self.table, self.ground_action)
        self._trees[player] = tree
        return tree

    def parse(
        self,
        state: State,
        player: str,
        sentence: str,
        *,
        exact: bool = False,
        valid: bool = True,
    ) -> GroundAction:
        """The action of a player that a sentence says (world.md, "Sentences").

        A full stop at its end, brackets or quotes around it, blanks and case do not matter, and
        `move(robot1, table1, table2)` will do: the domain's name and order of arguments.

        Args:
            state: The state in which the action is to be done.
            player: Whose action it is.
            sentence: The text to read.
            exact: The text has to be the sentence of a valid action, character for character.
            valid: The action has to be valid in the state. If not, any that the task has is
                given, another player's too, and `unmet` says what speaks against it.

        Raises:
            UnknownNameError: It says no such action, or several, and the message gives these, or
                what is unmet, or the nearest valid sentences; or there is no such player.
            WrongArgumentError: The sentence is no string.
        """
        actions = self.actions(state, player)
        if exact:
            found = said_exactly(sentence, actions)
            if found is None:
                raise no_valid_action(sentence, actions)
            return found
        return self._said(state, sentence, actions, valid=valid)

    def _said(
        self, state: State, sentence: str, actions: Sequence[GroundAction], *, valid: bool = True
    ) -> GroundAction:
        found = said(sentence, actions)
        if found is not None:
            return found
        action = known(sentence, self)
        if action is None:
            raise no_valid_action(sentence, actions)
        if not valid:
            return action
        unmet = [each.words for each in self.unmet(state, action)]
        raise no_valid_action(sentence, actions, unmet or [f"it moves {action.player}"])

    # Bytes

    def pack(self, state: State) -> bytes:
        """A state of this world as some 100 bytes, for another process that has this world, too.

        `pickle` sends a state's world along: its name if it is shipped, else the whole task.
        """
        rows = PackedState(state.facts, state.timer_rows(), state.timers.busy)
        return packed(self.task, rows)

    def unpack(self, data: bytes) -> State:
        """The state that `pack` made bytes of, in this world or in another one of its task.

        Raises:
            WrongArgumentError: These are no bytes of a packed state.
            UnknownNameError: They speak of an action or object that this world has not.
            WrongWorldError: They are those of another task's state, or of none that this world
                can be in, or more than `MAX_CREATED` objects of a kind were created.
        """
        state = unpacked(self.task, data)
        self._make_room_for(state.facts, MAX_CREATED)
        if state.facts.bit_length() > len(self.table.atoms):
            raise WrongWorldError(
                f"facts of another world, or more than {MAX_CREATED} created objects of a kind"
            )
        return self.restore(*state)

    # Steps

    def applicable(self, state: State, action: GroundAction) -> bool:
        """Whether an action applies in a state; both must be of this world.

        Raises:
            WrongArgumentError: The action is none.
        """
        try:
            met = state.facts & action.tested == action.required
        except AttributeError:
            raise not_an_action(action) from None
        return met and not state.timers.busy_steps(action.player)

    def successor(self, state: State, action: GroundAction) -> State:
        """The state after one player's valid action: the fast path for search.

        Both must be of this world. It is noticed if they are not where the action starts an
        effect or takes several steps, and otherwise the answer is wrong.

        Raises:
            InapplicableError: The action does not apply.
            WrongArgumentError: The action is none.
            WrongWorldError: The action was made by another world, and that was noticed.
        """
        facts = state.facts
        try:
            met = facts & action.tested == action.required
        except AttributeError:
            raise not_an_action(action) from None
        if not met or (state.timers.busy and state.timers.busy_steps(action.player)):
            raise InapplicableError(action.sentence, self.unmet(state, action))
        facts = (facts | action.touched) ^ action.removed
        timers = state.timers
        if action.effects or action.duration > 1:
            touched, removed, timers = timers.begin(action, facts)
            facts = (facts | touched) ^ removed
        if timers.entries or timers.busy:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        return State(self, facts, timers)

    def joint_successor(
        self, state: State, actions: Iterable[GroundAction | None]
    ) -> tuple[State, tuple[bool, ...]]:
        """The state after a step of several players, and which of the actions were applied: the
        fast path of `step`, without its checks and without reasons.

        Args:
            state: One of this world.
            actions: Those of this world, of one player each, in the order in which they apply;
                None does nothing, and counts as applied.

        Raises:
            WrongWorldError: An action was made by another world, and that was noticed.
        """
        facts, timers, applied = state.facts, state.timers, []
        for action in actions:
            if action is None:
                applied.append(True)
                continue
            valid = facts & action.tested == action.required
            if valid and timers.busy:
                valid = not timers.busy_steps(action.player)
            applied.append(valid)
            if valid:
                facts = (facts | action.touched) ^ action.removed
                if action.effects or action.duration > 1:
                    touched, removed, timers = timers.begin(action, facts)
                    facts = (facts | touched) ^ removed
        if timers.entries or timers.busy:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        return State(self, facts, timers), tuple(applied)

    def step(
        self,
        state: State,
        actions: JointAction,
    ) -> Step:
        """Apply a joint action, one player's after the other's, then let a step of time pass.

        An action whose preconditions do not hold when its turn comes is rejected and changes
        nothing. So is a player's second one.

        Args:
            state: One of this world, or of another world of the same task.
            actions: A `GroundAction`, the sentence of one that is valid in `state`, a list of
                these in the order in which they apply (None does nothing), or a dict of them by
                player.

        Returns:
            The new state, with an `Attempt` for each action in the same order.

        Raises:
            UnknownNameError: A sentence is that of no valid action, and the message says what is
                unmet or gives the nearest; or there is no such player.
            WrongArgumentError: Something is no action at all.
            WrongWorldError: The state or an action is one of another task.
        """
        if state.world is not self:
            state = self._own(state)
        facts, timers = state.facts, state.timers
        attempts = []
        acted: set[str] = set()
        for player, action in self._in_order(state, actions):
            actor = action.player or player
            unmet: tuple[Unmet, ...] = ()
            if actor is not None and actor in acted:
                unmet = acted_already(actor)
            elif facts & action.tested != action.required or timers.busy:
                unmet = unmet_in(self, facts, timers, action, actor)
            if unmet:
                attempts.append(Attempt(action, False, unmet))
                continue
            if actor is not None:
                acted.add(actor)
            facts = (facts | action.touched) ^ action.removed
            if action.effects or action.duration > 1:
                touched, removed, timers = timers.begin(action, facts)
                facts = (facts | touched) ^ removed
            attempts.append(Attempt(action, True))
        if timers:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        after = State(self, facts, timers)
        return Step(after, tuple(attempts), after.goal_reached)

    def _in_order(
        self, state: State, joint: JointAction
    ) -> Iterable[tuple[str | None, GroundAction]]:
        if type(joint) is GroundAction and joint.source is self:
            return ((None, joint),)
        return [
            (player, action)
            if type(action) is GroundAction and action.source is self
            else (player, read(action, self, self._reader(state, player)))
            for player, action in in_order(joint, self.players)
        ]

    def _reader(self, state: State, player: str | None) -> Callable[[str], GroundAction]:
        """How the sentences of a player are read, or those of any player."""
        return lambda sentence: self._said(state, sentence, tuple(self._valid(state, player)))

    def _valid(self, state: State, player: str | None) -> Iterator[GroundAction]:
        """What a player can do, or any player."""
        names = self.players if player is None else (player,)
        yield from dict.fromkeys(a for name in names for a in self.actions(state, name))

    def unmet(self, state: State, action: GroundAction) -> tuple[Unmet, ...]:
        """What speaks against an action in a state: preconditions above all; empty if nothing.

        Raises:
            WrongArgumentError: The action is none.
        """
        if not isinstance(action, GroundAction):
            raise not_an_action(action)
        return unmet_in(self, state.facts, state.timers, action, action.player)

    def changes(self, before: State, after: State) -> tuple[list[Atom], list[Atom]]:
        """The facts added and removed between two states, by bit."""
        internal = ~self.table.internal
        added = after.facts & ~before.facts & internal
        removed = before.facts & ~after.facts & internal
        atoms = self.table.atoms
        return [atoms[i] for i in bits_of(added)], [atoms[i] for i in bits_of(removed)]

    def _own(self, state: State) -> State:
        other = state.world.task
        if other.digest != self.task.digest:
            raise WrongWorldError(f"the state is one of another task, {other.name}")
        return self.restore(state.facts, state.timer_rows(), state.timers.busy)

    def restore(
        self,
        facts: int,
        rows: Sequence[TimerRow],
        busy: Sequence[BusyRow] = (),
    ) -> State:
        """A state from its facts, `State.timer_rows()` and busy players.

        Args:
            facts: `State.facts`, one bit for each atom of this world's table.
            rows: The active effects, in order of creation.
            busy: The players who are walking or working, each with the steps that are left.

        Raises:
            UnknownNameError: A row speaks of an action, object or player that this world has not.
            WrongWorldError: The facts or a row cannot be of this world.
            WrongArgumentError: The facts are no integer, or the rows are none.
        """
        if not isinstance(facts, int):
            raise WrongArgumentError(f"expected the facts of a state, an integer; found {facts!r}")
        self._make_room_for(facts)
        if facts < 0 or facts.bit_length() > len(self.table.atoms):
            raise WrongWorldError("facts of another world")
        self._check_existence(facts)
        return State(self, facts, self.timers.restored(rows, busy))


Slots = tuple[tuple[str, int], ...]

_worlds: weakref.WeakValueDictionary[tuple[str, Slots], World] = weakref.WeakValueDictionary()


def shared_world(task: Task, slots: Mapping[str, int] | None = None) -> World:
    """One world per task (and slots of its arrays, if they are not the usual ones) and process:
    worlds have no course of play in them, so may be shared."""
    key = task.digest, tuple(sorted((slots or {}).items()))
    world = _worlds.get(key)
    if world is None:
        world = _worlds[key] = World(task, slots=slots)
    return world


def _shipped_world(
    name: str, seats: int, timing: str, digest: str, slots: Mapping[str, int] | None = None
) -> World:
    world = _worlds.get((digest, tuple(sorted((slots or {}).items()))))
    if world is None:
        task = load_task(name, seats=seats, timing=timing, files=False)
        if task.digest != digest:
            raise WrongWorldError(f"{name} is not the task that it was where this was pickled")
        world = shared_world(task, slots)
    return world
