"""How the states of one instance look to learners: as arrays, as large in every instance."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from operator import and_
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.spaces import GraphInstance

from robotouille.domain.task import Task
from robotouille.envs.rules import Observation
from robotouille.errors import InapplicableError, WrongArgumentError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.timers import Timers
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World, shared_world

__all__ = [
    "Mask",
    "Numbers",
    "Seen",
    "Sizes",
    "Vector",
    "View",
    "asked_for",
    "observation_space",
    "views_of",
]

Mask = npt.NDArray[np.int8]
"""Which actions are valid, as Gymnasium's `sample` takes it: 1 or 0."""

Vector = npt.NDArray[np.float32]

Numbers = tuple[int | None, ...]
"""Those of each player's action, or None for nothing."""

Number = TypeVar("Number", bound=np.generic)

MAX_TEXT = 100_000
CHARACTERS = frozenset(map(chr, (10, *range(32, 127), *range(160, 384))))
"""What observations in words are made of, and how many letters they have at most."""

MAX_KEPT_BYTES = 64 * 1024 * 1024
"""Of arrays that an instance's states were found to be; then it begins anew."""


class Sizes(NamedTuple):
    """How many numbers a vector has, how large they are, and how many actions each player has, in
    the largest instance."""

    vector: int
    high: int
    actions: tuple[int, ...]


class Seen(NamedTuple):
    """What a state was found to be; nobody writes to it."""

    vector: Vector
    masks: tuple[Mask, ...]
    goal_reached: bool


class View:
    """One instance as learners see it. All environments of an instance share one in a process; it
    travels to another one as its world does, and what is kept does not."""

    def __init__(self, world: World, sizes: Sizes) -> None:
        self.world = world
        self.sizes = sizes
        self.actions = tuple(world.ground_actions(player) for player in world.players)
        self._encoding = world.encoding
        self._seen: dict[tuple[int, Timers], Seen] = {}
        item = 4 * sizes.vector + sum(sizes.actions) + 1_000
        self._room = max(100, MAX_KEPT_BYTES // item)

    def __deepcopy__(self, memo: dict[int, Any]) -> View:
        return self

    def __copy__(self) -> View:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _shared_view, (self.world, self.sizes)

    def seen(self, state: State) -> Seen:
        """A state's arrays, which are not to be changed."""
        key = state.facts, state.timers
        found = self._seen.get(key)
        if found is None:
            if len(self._seen) >= self._room:
                self._seen.clear()
            found = self._seen[key] = self._look(state)
        return found

    def _look(self, state: State) -> Seen:
        masks = (state.mask(player).view(np.int8) for player in self.world.players)
        padded = tuple(map(_padded, masks, self.sizes.actions))
        return Seen(_padded(state.vector(), self.sizes.vector), padded, state.goal_reached)

    def action(self, state: State, place: int, number: int) -> GroundAction | None:
        """A player's action of a number; None for one that this instance, or its state, has not."""
        actions = self.actions[place]
        if number >= len(actions):
            return None
        if self._encoding.slots.filled(state.facts):
            return state.action(self.world.players[place], number)
        return actions[number]

    def after(self, state: State, numbers: Numbers) -> tuple[State, tuple[bool, ...]]:
        """The state after a step in which each player does the action of a number, which is valid
        in `state`, or nothing (None), and whose action was applied.

        Players act in the order of seats, and one may spoil what the next wanted.
        """
        if len(numbers) == 1 and (number := numbers[0]) is not None:
            action = self.action(state, 0, number)
            if action is not None:
                return self.world.successor(state, action), (True,)
        actions = [
            None if number is None else self.action(state, place, number)
            for place, number in enumerate(numbers)
        ]
        after, applied = self.world.joint_successor(state, actions)
        return after, tuple(map(and_, applied, map(bool, actions)))

    def inapplicable(self, state: State, place: int, number: int) -> InapplicableError:
        """What is raised where a player's action of a number is not valid, and that is an error."""
        action = self.action(state, place, number)
        if action is None:
            missing = Unmet(UnmetKind.MISSING, "it is about an object that does not exist")
            return InapplicableError(f"action {number}", (missing,))
        return InapplicableError(action.sentence, self.world.unmet(state, action))

    def observation(self, state: State, kind: Observation, players: Sequence[str]) -> Any:
        """What players see of a state, if that is no vector."""
        if kind is Observation.TEXT:
            return "\n\n".join(state.text_view(player) for player in players)
        nodes, edges, counters = state.graph()
        relations = edges[:, :1].astype(np.float32)
        return GraphInstance(nodes, np.hstack([relations, counters]), edges[:, 1:])


def _padded(array: npt.NDArray[Number], size: int) -> npt.NDArray[Number]:
    """An array with zeros behind it up to a size."""
    return array if len(array) == size else np.pad(array, (0, size - len(array)))


_views: weakref.WeakValueDictionary[tuple[World, Sizes], View] = weakref.WeakValueDictionary()


def _shared_view(world: World, sizes: Sizes) -> View:
    view = _views.get((world, sizes))
    if view is None:
        view = _views[world, sizes] = View(world, sizes)
    return view


def views_of(tasks: Sequence[Task], slots: Any = None) -> tuple[View, ...]:
    """The views of instances, all of the sizes of the largest."""
    worlds = [shared_world(task, slots) for task in tasks]
    seats = range(len(worlds[0].players))
    sizes = Sizes(
        max(world.encoding.size for world in worlds),
        max(world.encoding.high for world in worlds),
        tuple(max(len(w.ground_actions(w.players[i])) for w in worlds) for i in seats),
    )
    return tuple(_shared_view(world, sizes) for world in worlds)


def asked_for(views: Sequence[View], options: Mapping[str, Any] | None) -> View | None:
    """The instance that the options of a reset ask for, by its task, its name or its number.

    Raises:
        WrongArgumentError: It is none of these.
    """
    wanted = (options or {}).get("instance")
    if wanted is None:
        return None
    for number, view in enumerate(views):
        task = view.world.task
        if wanted in (number, task.name) or (isinstance(wanted, Task) and wanted == task):
            return view
    names = ", ".join(view.world.task.name for view in views)
    raise WrongArgumentError(f"instance: expected one of {names}, found {wanted!r}")


def observation_space(kind: Observation, view: View) -> spaces.Space[Any]:
    """The space of what is seen."""
    if kind is Observation.TEXT:
        return spaces.Text(MAX_TEXT, min_length=0, charset=CHARACTERS)
    if kind is Observation.VECTOR:
        return spaces.Box(-1.0, view.sizes.high, (view.sizes.vector,), np.float32)
    encoding = view.world.encoding
    high = max(view.sizes.high, len(encoding.relations))
    nodes = spaces.Box(-1.0, high, (len(encoding.features),), np.float32)
    edges = spaces.Box(-1.0, high, (1 + encoding.counters,), np.float32)
    return spaces.Graph(nodes, edges)
