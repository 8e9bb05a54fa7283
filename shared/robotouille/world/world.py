"""Markov decision process of a task: states, valid actions and steps (paper, section 2).

world = World(load_task("synchronous/01_cheese_sandwich"))
state = world.initial
state = state.step(state.actions("robot1")[0]).state

`World` and `State` refer to each other and share this module. Their base classes `GroundTask` and
`GroundState` contain the parts that do not need the other class. Transitions come from `Timers`,
valid actions from `SuccessorTree`.
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
)
from robotouille.world.ground_state import (
    GroundState,
    JointAction,
    PackedState,
    in_order,
    not_an_action,
    packed,
    read,
    unpacked,
)
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.ground_objects import MAX_CREATED
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, atom_name
from robotouille.world.grounding.successors import SuccessorTree
from robotouille.world.shift import Orders, ShiftRules
from robotouille.world.slot_counts import slot_counts
from robotouille.world.text import (
    conditions_text,
    find_by_exact_sentence,
    find_by_sentence,
    find_valid_by_sentence,
    goal_sentences,
    no_valid_action,
    observation,
    orders_text,
    text_view,
)
from robotouille.world.timers import BusyRow, TimerRow, Timers, TimerTable
from robotouille.world.unmet import Attempt, Unmet, acted_already, unmet_in

if TYPE_CHECKING:
    from numpy import bool_, float32
    from numpy.typing import NDArray

    from robotouille.world.arrays.encoding import Encoding
    from robotouille.world.arrays.graph import Graph


class State(GroundState):
    """State `s = (facts, timers)` of the paper's section 2; in a shift also the `orders`.

    States are immutable, hashable and small: an integer and a shared tuple. `pickle` and `copy`
    work. States are equal if their facts, timers and orders are equal.
    """

    # Searches keep millions of states. Without slots each would carry a dictionary.
    __slots__ = ()

    world: World

    def __init__(
        self, world: World, facts: int, timers: Timers, orders: Orders | None = None
    ) -> None:
        self.world = world
        self.facts = facts
        self.timers = timers
        self.orders = orders

    def __repr__(self) -> str:
        return f"<State of {self.world.task.name} {self.digest}>"

    # States never change, so a copy may be the same object.
    def __copy__(self) -> State:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> State:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        # Rows name the actions and objects of effects, whose numbers differ between processes.
        orders = () if self.orders is None else (self.orders.row,)
        return _restore, (self.world, self.facts, self.timer_rows(), self.timers.busy, *orders)

    def actions(self, player: str) -> tuple[GroundAction, ...]:
        """Return the valid actions of a player, in the domain's order and then by object.

        A busy player has none.

        Raises:
            UnknownNameError: No such player.
        """
        return self.world.actions(self, player)

    def step(self, actions: JointAction) -> Step:
        """Apply a joint action and let one step of time pass; see `World.step`.

        Args:
            actions: A `GroundAction`, the sentence of a valid one, a list of them in the order in
                which they apply (None does nothing), or a dict by player.

        Raises:
            UnknownNameError: A sentence matches no valid action, or a player does not exist.
            WrongArgumentError: A value is not an action.
            WrongWorldError: An action belongs to another task.
        """
        return self.world.step(self, actions)

    @property
    def shift_over(self) -> bool:
        """True after the last step of a shift."""
        shift = self.world.shift
        return shift is not None and self.orders is not None and shift.over(self.orders)

    def mask(self, player: str) -> NDArray[bool_]:
        """Return a boolean for each of `World.ground_actions(player)`: whether it is valid.

        Raises:
            UnknownNameError: No such player.
            SlotOverflowError: More created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.mask(self.facts, player, self.actions(player))

    def vector(self) -> NDArray[float32]:
        """Return the state as a vector whose length depends on the task only (docs/train.md).

        Raises:
            SlotOverflowError: More created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.vector(self.facts, self.timers, self.orders)

    def without(self, atoms: Iterable[Atom]) -> State:
        """Return this state with some facts made false; running effects continue.

        Args:
            atoms: Facts as `atoms` lists them; facts that are false already are ignored.

        Raises:
            UnknownNameError: An atom does not exist in this world.
        """
        facts, bits = self.facts, self.world.table.bit
        for atom in atoms:
            if atom not in bits:
                raise UnknownNameError(f"there is no fact {atom_name(atom)}")
            facts &= ~bits[atom]
        return State(self.world, facts, self.timers, self.orders)

    def graph(self) -> Graph:
        """Return the state as arrays of a graph of objects and relations (docs/train.md).

        The graph does not contain the orders of a shift, which are about no object.

        Raises:
            SlotOverflowError: More created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.graph(self.facts, self.timers)

    def action(self, player: str, number: int) -> GroundAction | None:
        """Return the action with a number: its index in `World.ground_actions(player)`.

        If a number refers to a slot, its action uses the object that is in the slot now.

        Returns:
            The action, valid or not; None if one of its slots is empty.

        Raises:
            UnknownNameError: No such player.
            WrongArgumentError: No such number.
            SlotOverflowError: More created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        return self.world.encoding.action(self.facts, player, number)

    def action_number(self, action: GroundAction, player: str | None = None) -> int:
        """Return the number of an action: the inverse of `action`.

        Args:
            action: An action of this task.
            player: Player whose numbering to use; by default the acting player.

        Raises:
            UnknownNameError: The action is unreachable, or the player does not exist.
            SlotOverflowError: More created objects than slots.
            MissingExtraError: NumPy is not installed.
        """
        whose = player or action.player or self.world.players[0]
        return self.world.encoding.number(self.facts, whose, action)

    def text(self, player: str | None = None) -> str:
        """Return the observation in words (docs/episodes.md, "In words").

        Args:
            player: Player whose valid actions are listed at the end; by default the first.

        Raises:
            UnknownNameError: No such player.
        """
        return observation(self.world, self.facts, self.actions(player or self.world.players[0]))

    def text_view(self, player: str | None = None) -> str:
        """Return the text for a language model: the player's name, `text`, and what is to be done.

        The last part lists the conditions of the goal, or the menu and the orders of a shift.

        Args:
            player: Player of the agent; None for a spectator.

        Raises:
            UnknownNameError: No such player.
        """
        shift, orders = self.world.shift, self.orders
        if shift is not None and orders is not None:
            end = orders_text(self.world, shift, orders)
        else:
            end = conditions_text(self.world.goal_terms(self))
        return text_view(self.text(player), player, end)


def _restore(
    world: World,
    facts: int,
    rows: tuple[TimerRow, ...],
    busy: tuple[BusyRow, ...],
    orders: Sequence[Any] | None = None,
) -> State:
    return world.restore(facts, rows, busy, orders)


class Step(NamedTuple):
    """Result of a step: the new state, its reward, and an attempt for each action.

    `points` are those that the step has earned or lost in a shift.
    """

    state: State
    attempts: tuple[Attempt, ...]
    goal_reached: bool
    points: int = 0

    @property
    def reward(self) -> float:
        """1 on a step that reaches the goal, in a shift the points, otherwise 0."""
        return 1.0 if self.goal_reached else float(self.points)


class World(GroundTask):
    """Grounded task: its initial state, valid actions and steps.

    `task` is the task it was made from. `players` are the names of its players in seat order.
    `shift` are the rules of its orders, if it has a shift instead of a goal.

    A world contains no data of episodes, so all episodes of a task may share one. Its methods
    change its caches, so only one thread at a time may use it. Three parts of it grow:

    - Objects and atoms grow in generations (`GroundObjects`), when a step or `restore` needs more
      created objects than there is room for. Bits never move, so states, actions and timers stay
      valid. Successor trees and the goal's caches are rebuilt.
    - Ground actions and effects are made on first use and kept.
    - Caches: successor trees (at most `successors.MAX_NODES` nodes a player), transitions of timers
      (`timers.MAX_KEPT`) and facts that reach the goal (`goal.MAX_KEPT`). A full cache is emptied.

    Args:
        task: A task, or a name or path for `load_task`.
        slots: Number of created objects for which arrays have room, by kind, instead of the
            default (docs/train.md).

    Raises:
        UnknownTaskError: No task or file has that name.
        FileError: The task's files are invalid.
        WrongArgumentError: `slots` is invalid.
    """

    def __init__(self, task: Task | str, *, slots: Mapping[str, int] | None = None) -> None:
        super().__init__(task if isinstance(task, Task) else load_task(task))
        self._slots = slot_counts(slots)
        self.timers = TimerTable(self)
        shift = self.task.problem.shift
        self.shift = None if shift is None else ShiftRules(self, shift)
        self._trees: dict[str, SuccessorTree] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        # The pickle of a shipped task is its name and digest: states are sent often, and the task
        # is a hundred times as large as a state.
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
        # The nodes of a tree test only bits of atoms that existed when the nodes were made.
        self._trees.clear()
        if self.shift is not None:
            self.shift.refresh()

    @cached_property
    def _is_shipped(self) -> bool:
        """True if the task can be loaded by name, so that pickles need not contain it."""
        task = self.task
        try:
            # Without `files=False`, a file of that name in the working directory would count.
            known = load_task(task.name, seats=task.seats, timing=task.timing, files=False)
        except RobotouilleError:
            return False
        return known.digest == task.digest

    @cached_property
    def initial(self) -> State:
        """State in which every episode of the task begins."""
        orders = None if self.shift is None else self.shift.initial
        return State(self, self.initial_facts, self.timers.none, orders)

    def reached_by(self, player: str) -> frozenset[str]:
        """Return the stations to which a player can walk; a counter can divide a kitchen."""
        layout, static = self.task.domain.layout or (), self.table.static
        predicates = [rule.predicate for rule in layout if rule.when == "reaches"]
        return frozenset(
            s for s in self.floor.stations if all((p, player, s) in static for p in predicates)
        )

    @cached_property
    def is_undivided(self) -> bool:
        """True if all players can walk to all stations."""
        return all(self.reached_by(p) == self.floor.stations.keys() for p in self.players)

    @cached_property
    def _goal_sentences(self) -> tuple[str, ...]:
        return goal_sentences(self, self.goal)

    def goal_terms(self, state: State) -> tuple[tuple[str, bool], ...]:
        """Return each condition of the goal in words, and whether it holds in a state.

        Conditions are in the problem's order. A condition holds if some choice of objects makes it
        true together with all earlier ones that hold. So all of them hold exactly if the goal is
        reached.
        """
        return tuple(zip(self._goal_sentences, self.goal.holding(state.facts), strict=True))

    # Arrays

    @cached_property
    def encoding(self) -> Encoding:
        """Encoding of states as vectors and graphs, and of actions as numbers (docs/train.md).

        Raises:
            WrongArgumentError: `slots` names a kind that cannot be created.
            MissingExtraError: NumPy is not installed.
        """
        try:
            from robotouille.world.arrays.encoding import Encoding
        except ImportError:  # NumPy is optional: servers, bots and planners work without it.
            raise MissingExtraError("states as arrays", "rl") from None
        return Encoding(self, dict(self._slots), self.shift)

    def ground_actions(self, player: str) -> tuple[GroundAction, ...]:
        """Return all reachable actions of a player, in a fixed order.

        Raises:
            UnknownNameError: No such player.
            MissingExtraError: NumPy is not installed.
        """
        return self.encoding.ground_actions(player)

    # Actions

    def actions(self, state: State, player: str) -> tuple[GroundAction, ...]:
        """Return the valid actions of a player in a stable order; none while the player is busy.

        Raises:
            UnknownNameError: No such player.
        """
        try:
            tree = self._trees[player]
        except (KeyError, TypeError):  # TypeError: the name is not hashable, so it is unknown too.
            tree = self._new_tree(player)
        if state.timers.busy and state.timers.busy_steps(player):
            return ()
        return tree.actions(state.facts)

    def _new_tree(self, player: str) -> SuccessorTree:
        if player not in self.players:
            raise UnknownNameError.player(player, self.players)
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
        """Return the action that a sentence names (docs/episodes.md, "Sentences").

        A full stop at the end, surrounding brackets or quotes, blanks and case do not matter.
        `move(robot1, table1, table2)` works too, with the domain's name and order of arguments.

        Args:
            state: State in which the action is to be taken.
            player: Acting player.
            sentence: Text to read.
            exact: Accept only the exact sentence of a valid action.
            valid: Require a valid action. Otherwise any action of the task is returned, even one
                of another player, and `unmet` has the reasons against it.

        Raises:
            UnknownNameError: The player does not exist, or the sentence names no action or several.
                The message lists the actions, the unmet conditions or the nearest sentences.
            WrongArgumentError: The sentence is not a string.
        """
        actions = self.actions(state, player)
        if exact:
            found = find_by_exact_sentence(sentence, actions)
            if found is None:
                raise no_valid_action(sentence, actions)
            return found
        return self._said(state, sentence, actions) if valid else self.named(sentence, actions)

    def named(self, sentence: str, offered: Sequence[GroundAction]) -> GroundAction:
        """Return the action of the task that a sentence names, valid or not.

        Args:
            sentence: Text to read, as for `parse`.
            offered: Actions that ambiguous sentences and suggestions refer to.

        Raises:
            UnknownNameError: The sentence names no action or several.
            WrongArgumentError: The sentence is not a string.
        """
        found = self.find_named(sentence, offered)
        if found is None:
            raise no_valid_action(sentence, offered)
        return found

    def find_named(self, sentence: str, offered: Sequence[GroundAction]) -> GroundAction | None:
        """Return the action of the task that a sentence names, or None.

        This takes a tenth of the time in which `named` finds the suggestions of its error.

        Args:
            sentence: Text to read, as for `parse`.
            offered: Actions that ambiguous sentences refer to.

        Raises:
            UnknownNameError: The sentence names several actions.
            WrongArgumentError: The sentence is not a string.
        """
        found = find_valid_by_sentence(sentence, offered)
        return found if found is not None else find_by_sentence(sentence, self)

    def _said(self, state: State, sentence: str, actions: Sequence[GroundAction]) -> GroundAction:
        action = self.named(sentence, actions)
        if action in actions:
            return action
        unmet = [each.words for each in self.unmet(state, action)]
        raise no_valid_action(sentence, actions, unmet or [f"it is an action of {action.player}"])

    # Bytes

    def pack(self, state: State) -> bytes:
        """Return a state as about 100 bytes, for a process that has this world too.

        `pickle` also sends the world: its task's name if shipped, otherwise the whole task.
        """
        orders = None if state.orders is None else state.orders.row
        rows = PackedState(state.facts, state.timer_rows(), state.timers.busy, orders)
        return packed(self.task, rows)

    def unpack(self, data: bytes) -> State:
        """Return the state that `pack` encoded, in this world or another one of its task.

        Raises:
            WrongArgumentError: The data is not a packed state.
            UnknownNameError: The data names an unknown action or object.
            WrongWorldError: The state belongs to another task, is impossible in this world, or has
                more than `MAX_CREATED` created objects of a kind.
        """
        state = unpacked(self.task, data)
        # The bound keeps hostile bytes from growing the world without limit.
        self._make_room_for(state.facts, MAX_CREATED)
        if state.facts.bit_length() > len(self.table.atoms):
            raise WrongWorldError(
                f"facts of another world, or more than {MAX_CREATED} created objects of a kind"
            )
        return self.restore(*state)

    # Steps

    def applicable(self, state: State, action: GroundAction) -> bool:
        """Return whether an action applies in a state; both must belong to this world.

        Raises:
            WrongArgumentError: `action` is not an action.
        """
        # This is the fast path: `try` costs nothing here, but `isinstance` would cost time.
        try:
            # One mask and one comparison test all preconditions, positive and negative.
            met = state.facts & action.tested == action.required
        except AttributeError:
            raise not_an_action(action) from None
        return met and not state.timers.busy_steps(action.player)

    def successor(self, state: State, action: GroundAction) -> State:
        """Return the state after one player's valid action: the fast path for search.

        The state and the action must belong to this world. A foreign action is only detected if it
        starts an effect or takes several steps; otherwise the result is wrong.

        Raises:
            InapplicableError: The action does not apply.
            WrongArgumentError: `action` is not an action.
            WrongWorldError: The action was made by another world.
        """
        facts, timers = state.facts, state.timers
        try:
            met = facts & action.tested == action.required
        except AttributeError:
            raise not_an_action(action) from None
        if not met or (timers.busy and timers.busy_steps(action.player)):
            raise InapplicableError(action.sentence, self.unmet(state, action))
        # Two operations apply an action: `touched` sets every atom that it writes, `removed`
        # clears those that it makes false.
        facts = (facts | action.touched) ^ action.removed
        if action.effects or action.duration > 1:
            touched, removed, timers = timers.begin(action, facts)
            facts = (facts | touched) ^ removed
        if timers.pending:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        if self.shift is not None:
            return self._fulfilled(state, facts, timers)
        return State(self, facts, timers)

    def joint_successor(
        self, state: State, actions: Iterable[GroundAction | None]
    ) -> tuple[State, tuple[bool, ...]]:
        """Return the state after a step of several players, and which actions were applied.

        This is the fast path of `step`, without its checks and reasons.

        Args:
            state: State of this world.
            actions: At most one action of this world per player, in the order in which they apply.
                None does nothing and counts as applied.

        Raises:
            WrongWorldError: An action was made by another world. Not all such actions are detected.
        """
        # This repeats the loop of `step` without reasons and attempts, because team searches call
        # it for every joint action that they generate.
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
        if timers.pending:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        if self.shift is not None:
            return self._fulfilled(state, facts, timers), tuple(applied)
        return State(self, facts, timers), tuple(applied)

    def _fulfilled(self, before: State, facts: int, timers: Timers) -> State:
        """Return the state after the orders of a shift were served, expired and arrived."""
        if self.shift is None:
            raise AssertionError("a task without a shift has no orders")
        orders = self.shift.initial if before.orders is None else before.orders
        return State(self, *self.shift.advance(facts, timers, orders))

    def step(
        self,
        state: State,
        actions: JointAction,
    ) -> Step:
        """Apply the actions of a joint action in order, then let one step of time pass.

        An action whose preconditions do not hold when its turn comes is rejected and changes
        nothing (docs/decisions/0005-invalid-actions-cost-nothing.md). So is a player's
        second action.

        Args:
            state: State of this task.
            actions: A `GroundAction`, the sentence of an action that is valid in `state`, a list of
                them in the order in which they apply (None does nothing), or a dict by player.

        Returns:
            The new state, with an `Attempt` for each action in the same order.

        Raises:
            UnknownNameError: A sentence matches no valid action; the message has the unmet
                conditions or the nearest sentences. Or a player does not exist.
            WrongArgumentError: A value is not an action.
            WrongWorldError: The state or an action belongs to another task.
        """
        # Two worlds of a task may have given the same bit to different created objects.
        if state.world is not self:
            state = self._own(state)
        facts, timers = state.facts, state.timers
        attempts = []
        acted: set[str] = set()
        for player, action in self._in_order(state, actions):
            actor = action.player or player
            unmet: tuple[Unmet, ...] = ()
            # Effects of earlier actions are visible here: the players act one after another, and
            # only time passes for all at once (paper, section 2).
            if actor is not None and actor in acted:
                unmet = acted_already(actor)
            # Reasons are expensive, so they are computed only for actions that may be invalid.
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
        if timers.pending:
            touched, removed, timers = timers.tick(facts)
            facts = (facts | touched) ^ removed
        if self.shift is not None:
            after = self._fulfilled(state, facts, timers)
            return Step(after, tuple(attempts), False, _points(state, after))
        after = State(self, facts, timers)
        return Step(after, tuple(attempts), after.goal_reached)

    def _in_order(
        self, state: State, joint: JointAction
    ) -> Iterable[tuple[str | None, GroundAction]]:
        # This shortcut is for planners, most of whose calls have one action of this world.
        if type(joint) is GroundAction and joint.source is self:
            return ((None, joint),)
        return [
            (player, action)
            if type(action) is GroundAction and action.source is self
            else (player, read(action, self, self._reader(state, player)))
            for player, action in in_order(joint, self.players)
        ]

    def _reader(self, state: State, player: str | None) -> Callable[[str], GroundAction]:
        """Return the function that reads sentences of a player, or of any player if None."""
        return lambda sentence: self._said(state, sentence, tuple(self._valid(state, player)))

    def _valid(self, state: State, player: str | None) -> Iterator[GroundAction]:
        """Yield the valid actions of a player, or of all players if None."""
        names = self.players if player is None else (player,)
        yield from dict.fromkeys(a for name in names for a in self.actions(state, name))

    def unmet(self, state: State, action: GroundAction) -> tuple[Unmet, ...]:
        """Return the reasons why an action does not apply; empty if it does.

        Raises:
            WrongArgumentError: `action` is not an action.
        """
        if not isinstance(action, GroundAction):
            raise not_an_action(action)
        return unmet_in(self, state.facts, state.timers, action, action.player)

    def changes(self, before: State, after: State) -> tuple[list[Atom], list[Atom]]:
        """Return the facts added and removed between two states, in bit order."""
        # Internal atoms count objects; clients and recordings derive them from the objects.
        internal = ~self.table.internal
        added = after.facts & ~before.facts & internal
        removed = before.facts & ~after.facts & internal
        atoms = self.table.atoms
        return [atoms[i] for i in bits_of(added)], [atoms[i] for i in bits_of(removed)]

    def _own(self, state: State) -> State:
        other = state.world.task
        if other.digest != self.task.digest:
            raise WrongWorldError(f"the state belongs to another task, {other.name}")
        return self.restore(state.facts, state.timer_rows(), state.timers.busy, state.orders)

    def restore(
        self,
        facts: int,
        rows: Sequence[TimerRow],
        busy: Sequence[BusyRow] = (),
        orders: Sequence[Any] | None = None,
    ) -> State:
        """Return the state with these facts, timer rows, busy players and orders.

        Args:
            facts: `State.facts`, one bit for each atom of this world's table.
            rows: Active effects, in order of creation.
            busy: Players who are walking or working, with the steps that are left.
            orders: `Orders.row` of a state of a shift; None for its first orders.

        Raises:
            UnknownNameError: A row names an unknown action, object or player.
            WrongWorldError: The facts or a row do not fit this world.
            WrongArgumentError: The facts are not an integer, or a row has the wrong form.
        """
        if not isinstance(facts, int):
            raise WrongArgumentError(f"expected the facts as an integer, found {facts!r}")
        self._make_room_for(facts)
        # A negative integer would have infinitely many bits set.
        if facts < 0 or facts.bit_length() > len(self.table.atoms):
            raise WrongWorldError("the facts are of another world")
        # Facts about objects that do not exist would stay true for ever.
        self._check_existence(facts)
        timers = self.timers.restored(rows, busy)
        if self.shift is None:
            if orders is not None:
                raise WrongWorldError("the task has no shift, so it has no orders")
            return State(self, facts, timers)
        known = self.shift.initial if orders is None else self.shift.restored(orders)
        return State(self, facts, timers, known)


def _points(before: State, after: State) -> int:
    """Return the points that a step of a shift has earned or lost."""
    scores = [0 if state.orders is None else state.orders.score for state in (before, after)]
    return scores[1] - scores[0]


Slots = tuple[tuple[str, int], ...]

# The values are weak, so that worlds that no state or episode uses are freed.
_worlds: weakref.WeakValueDictionary[tuple[str, Slots], World] = weakref.WeakValueDictionary()


def shared_world(task: Task, slots: Mapping[str, int] | None = None) -> World:
    """Return the process's world for a task and slots; worlds hold nothing of an episode."""
    key = task.digest, slot_counts(slots)
    world = _worlds.get(key)
    # Grounding takes milliseconds, and a shared world shares its caches: a server opens many
    # episodes of one task.
    if world is None:
        world = _worlds[key] = World(task, slots=slots)
    return world


def _shipped_world(
    name: str, seats: int, timing: str, digest: str, slots: Mapping[str, int] | None = None
) -> World:
    world = _worlds.get((digest, slot_counts(slots)))
    if world is None:
        task = load_task(name, seats=seats, timing=timing, files=False)
        if task.digest != digest:
            raise WrongWorldError(f"{name} has changed since this state was pickled")
        world = shared_world(task, slots)
    return world
