"""Where players stand, and where they are in nobody's way."""

from __future__ import annotations

from collections.abc import Collection

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = [
    "is_out_of_the_way",
    "leads_to",
    "seat_out_of_the_way",
    "standing_at",
    "walk_to",
    "walks_aside",
    "walks_out_of_the_way",
]


def standing_at(state: State, player: str) -> str | None:
    """The station at which a player stands, judged by where it could walk from; None if it cannot
    walk at all."""
    walks = _walks(state, player)
    return walks[0].origin if walks else None


def walk_to(state: State, player: str, station: str | None) -> GroundAction | None:
    """A player's walk to a station; None if there is none now."""
    return next((w for w in _walks(state, player) if w.destination == station), None)


def walks_aside(state: State, player: str) -> list[GroundAction]:
    """A player's walks to stations that are plain and empty, or else at least plain; none if it
    stands at one that is plain and empty."""
    empty = _plain_and_empty(state)
    walks = _walks(state, player)
    if walks and walks[0].origin in empty:
        return []
    aside = [walk for walk in walks if walk.destination in empty]
    return aside or [walk for walk in walks if walk.destination in state.world.floor.plain]


def walks_out_of_the_way(state: State, player: str) -> list[GroundAction]:
    """Those of `walks_aside` that lead to where nobody wants to be."""
    empty = _plain_and_empty(state)
    return [walk for walk in walks_aside(state, player) if walk.destination in empty]


def _plain_and_empty(state: State) -> frozenset[str]:
    """The plain stations on which nothing lies."""
    used = {
        name
        for _, *arguments in state.atoms()
        if len(arguments) > 1 and arguments[0] not in state.world.players
        for name in arguments[1:]
    }
    return state.world.floor.plain - used


def _walks(state: State, player: str) -> list[GroundAction]:
    return [a for a in state.actions(player) if a.destination is not None]


def is_out_of_the_way(state: State, player: str) -> bool:
    """Whether a player stands where nobody wants to be: at a station that is plain and empty."""
    return standing_at(state, player) is not None and not walks_aside(state, player)


def seat_out_of_the_way(state: State) -> str:
    """The first player who stands in nobody's way: the seat for whoever may stand still for long.
    The first of all, where each of them does."""
    players = state.world.players
    return next((p for p in players if is_out_of_the_way(state, p)), players[0])


def leads_to(action: GroundAction, stations: Collection[str | None]) -> bool:
    """Whether an action is a walk to one of some stations."""
    return action.destination is not None and action.destination in stations
