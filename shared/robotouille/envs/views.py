"""Observations of states as arrays of equal sizes in all instances."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint
from itertools import zip_longest
from operator import and_
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from robotouille.domain.task import Task
from robotouille.errors import InapplicableError, MissingExtraError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.shift import Orders
from robotouille.world.timers import Timers
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World, shared_world

PAINTER = "robotouille_client.window.video:still"
"""Entry point of a function that draws a state and its step number as rows of pixels."""


def picture(state: State, step: int) -> Any:
    """Return a picture of a state as an array of shape (height, width, 3).

    Raises:
        MissingExtraError: pygame is not installed.
    """
    try:
        still: Callable[[State, int], Any] = EntryPoint("still", PAINTER, "robotouille").load()
    except ImportError:
        raise MissingExtraError("a picture of a kitchen", "window") from None
    return still(state, step)


Mask = npt.NDArray[np.int8]
"""Valid actions in the format of Gymnasium's `sample`: 1 or 0."""

Vector = npt.NDArray[np.float32]

Numbers = tuple[int | None, ...]
"""Number of each player's action, or None for nothing."""

Number = TypeVar("Number", bound=np.generic)

MAX_TEXT = 100_000
CHARACTERS = frozenset(map(chr, (10, *range(32, 127), *range(160, 384))))
"""Characters of text observations."""

MAX_KEPT_BYTES = 64 * 1024 * 1024
"""Maximum size of an instance's cached arrays."""


class Sizes(NamedTuple):
    """The largest sizes of all instances: vector length and values, and players' actions."""

    vector: int
    high: int
    actions: tuple[int, ...]


class StateArrays(NamedTuple):
    """The arrays of a state, which must not be changed, and whether the goal is reached.

    In a shift, `over` is True at its end, and `score` are the points so far.
    """

    vector: Vector
    masks: tuple[Mask, ...]
    goal_reached: bool
    over: bool = False
    score: int = 0


class ObservationView:
    """One instance with its observations.

    All environments of an instance in one process share one view. Pickling a view leaves out its
    cache.
    """

    def __init__(self, world: World, sizes: Sizes) -> None:
        self.world = world
        self.sizes = sizes
        self.actions = tuple(world.ground_actions(player) for player in world.players)
        self._encoding = world.encoding
        self._known: dict[tuple[int, Timers, Orders | None], StateArrays] = {}
        item = 4 * sizes.vector + sum(sizes.actions) + 1_000
        self._room = max(100, MAX_KEPT_BYTES // item)

    def __deepcopy__(self, memo: dict[int, Any]) -> ObservationView:
        return self

    def __copy__(self) -> ObservationView:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _shared_view, (self.world, self.sizes)

    def arrays(self, state: State) -> StateArrays:
        """Return a state's arrays, which must not be changed."""
        key = state.facts, state.timers, state.orders
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= self._room:
                self._known.clear()
            found = self._known[key] = self._new_arrays(state)
        return found

    def _new_arrays(self, state: State) -> StateArrays:
        masks = (state.mask(player).view(np.int8) for player in self.world.players)
        padded = tuple(map(_padded, masks, self.sizes.actions))
        vector = _padded(state.vector(), self.sizes.vector)
        score = 0 if state.orders is None else state.orders.score
        return StateArrays(vector, padded, state.goal_reached, state.shift_over, score)

    def action(self, state: State, place: int, number: int) -> GroundAction | None:
        """Return a player's action of a number, or None if the instance or the state lacks it."""
        actions = self.actions[place]
        if number >= len(actions):
            return None
        if self._encoding.slots.filled(state.facts):
            return state.action(self.world.players[place], number)
        return actions[number]

    def after(self, state: State, numbers: Numbers) -> tuple[State, tuple[bool, ...]]:
        """Return the state after a step, and the players whose action was applied.

        Each player takes the action of a number that is valid in `state`, or nothing (None).
        Players act in the order of seats, so one may prevent the action of the next.
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
        """Return the error for an action that is not valid."""
        action = self.action(state, place, number)
        if action is None:
            missing = Unmet(UnmetKind.MISSING, "it is about an object that does not exist")
            return InapplicableError(f"action {number}", (missing,))
        return InapplicableError(action.sentence, self.world.unmet(state, action))


def _padded(array: npt.NDArray[Number], size: int) -> npt.NDArray[Number]:
    """Return an array padded with zeros to a size."""
    return array if len(array) == size else np.pad(array, (0, size - len(array)))


_views: weakref.WeakValueDictionary[tuple[World, Sizes], ObservationView] = (
    weakref.WeakValueDictionary()
)


def _shared_view(world: World, sizes: Sizes) -> ObservationView:
    view = _views.get((world, sizes))
    if view is None:
        view = _views[world, sizes] = ObservationView(world, sizes)
    return view


def views_of(tasks: Sequence[Task], slots: Any = None) -> tuple[ObservationView, ...]:
    """Return the views of instances, all with the sizes of the largest one."""
    worlds = [shared_world(task, slots) for task in tasks]
    counts = [[len(world.ground_actions(player)) for player in world.players] for world in worlds]
    sizes = Sizes(
        max(world.encoding.size for world in worlds),
        max(world.encoding.high for world in worlds),
        tuple(map(max, zip_longest(*counts, fillvalue=0))),
    )
    return tuple(_shared_view(world, sizes) for world in worlds)


def largest_team(views: Sequence[ObservationView]) -> tuple[str, ...]:
    """Return the players of the instance that has most of them."""
    return max((view.world.players for view in views), key=len)


def text_space() -> spaces.Text:
    """Return the space of texts."""
    return spaces.Text(MAX_TEXT, min_length=0, charset=CHARACTERS)


def vector_space(sizes: Sizes) -> spaces.Box:
    """Return the space of states as vectors."""
    return spaces.Box(-1.0, sizes.high, (sizes.vector,), np.float32)
