"""Partial observability: the part of a state that one player sees (docs/train.md).

A player knows the kitchen's plan, which things exist and what never changes about them. Of things
out of sight it does not know where they are and in which condition.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, floor
from typing import NamedTuple

from robotouille.errors import UnknownNameError, WrongArgumentError, did_you_mean
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.objects import Tile
from robotouille.world.scene import scene
from robotouille.world.text import conditions_text, observation, orders_text, text_view
from robotouille.world.world import State


@dataclass(frozen=True)
class Sight:
    """Rule for what players see.

    Args:
        distance: Number of tiles that a player sees in each direction, also diagonally. None is no
            limit.
        blocked: True if stations hide what is behind them.

    Raises:
        WrongArgumentError: The distance is not a number of tiles.
    """

    distance: int | None = None
    blocked: bool = False

    def __post_init__(self) -> None:
        limit = self.distance
        if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int)):
            raise WrongArgumentError(f"distance: expected a number of tiles, found {limit!r}")
        if limit is not None and limit < 1:
            raise WrongArgumentError(f"distance: expected 1 or more tiles, found {limit}")

    def reaches(self, here: Tile, there: Tile, stations: frozenset[Tile]) -> bool:
        """Return whether a player on one tile sees another tile."""
        steps = max(abs(here[0] - there[0]), abs(here[1] - there[1]))
        if self.distance is not None and steps > self.distance:
            return False
        return not self.blocked or all(
            any(tile not in stations for tile in tiles) for tiles in _between(here, there, steps)
        )


class Seen(NamedTuple):
    """The part of a state that a player sees.

    Attributes:
        state: The state without facts and effects of things out of sight, apart from their
            existence. It is for observations only: steps from it are wrong.
        things: Names of the objects in sight.
        actions: The player's actions whose conditions in sight hold. If another condition is out
            of sight, the action may turn out to be invalid.
    """

    state: State
    things: frozenset[str]
    actions: tuple[GroundAction, ...]

    def text_view(self, player: str) -> str:
        """Return the text for a language model, as `State.text_view` does."""
        world, state = self.state.world, self.state
        hidden = [thing.name for thing in state.objects if thing.name not in self.things]
        if world.shift is not None and state.orders is not None:
            end = orders_text(world, world.shift, state.orders)
        else:
            end = conditions_text(world.goal_terms(state))
        beyond = f"Out of sight: {', '.join(hidden) or 'nothing'}."
        text = observation(world, state.facts, self.actions)
        return text_view(f"{beyond}\n\n{text}", player, end)


def seen_by(state: State, player: str, sight: Sight) -> Seen:
    """Return what a player sees of a state.

    Raises:
        UnknownNameError: No such player.
        MissingExtraError: NumPy is not installed.
    """
    world = state.world
    if player not in world.players:
        raise UnknownNameError(f"no player {player!r}{did_you_mean(player, world.players)}")
    things = frozenset(_in_sight(state, player, sight))
    hidden = 0
    for thing in state.objects:
        if thing.name not in things:
            hidden |= world.table.mentions(thing.name) & ~world.table.bit.get(
                (EXISTS, thing.name), 0
            )
    hidden &= ~world.table.internal
    timers = world.timers.get(
        tuple(entry for entry in state.timers.entries if things.issuperset(entry[0].label[2])),
        tuple(row for row in state.timers.busy if row[0] in things),
    )
    seen = State(world, state.facts & ~hidden, timers, state.orders)
    # A thing's relation to itself is no secret: otherwise everything out of sight seems to lie on
    # itself, and players could try to take it from there.
    doubtful = hidden & ~world.table.reflexive
    return Seen(seen, things, tuple(_seemingly_valid(state, player, doubtful)))


def _in_sight(state: State, player: str, sight: Sight) -> Iterator[str]:
    """Yield the objects that a player sees: also its own station and what it holds."""
    placed = scene(state)
    me, stations = placed[player], state.world.floor.blocked
    for name, thing in placed.items():
        own = name in (player, me.at) or player in (name, thing.host)
        if own or me.tile is None or thing.tile is None or (
            sight.reaches(me.tile, thing.tile, stations)
            or (me.at is not None and thing.tile == placed[me.at].tile)
        ):  # fmt: skip
            yield name


def _seemingly_valid(state: State, player: str, hidden: int) -> Iterator[GroundAction]:
    """Yield the player's actions whose conditions hold, apart from hidden ones."""
    if state.busy_steps(player):
        return
    world, facts = state.world, state.facts
    for number, listed in enumerate(world.ground_actions(player)):
        # Listed actions have the objects after which slots are named.
        action = listed
        if world.encoding.slots.filled(facts):
            found = state.action(player, number)
            if found is None:
                continue
            action = found
        known = action.tested & ~hidden
        if facts & known == action.required & known:
            yield action


def _between(here: Tile, there: Tile, steps: int) -> Iterator[set[Tile]]:
    """Yield the tiles on a straight line without its ends; two where it runs between them."""
    for i in range(1, steps):
        x = here[0] + (there[0] - here[0]) * i / steps
        y = here[1] + (there[1] - here[1]) * i / steps
        yield {(across, up) for across in _nearest(x) for up in _nearest(y)}


def _nearest(value: float) -> set[int]:
    return {floor(value + 0.5), ceil(value - 0.5)}
