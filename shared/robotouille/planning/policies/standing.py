"""Players' places, and places that are out of the way."""

from __future__ import annotations

from collections.abc import Collection

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State


def standing_at(state: State, player: str) -> str | None:
    """Return the station at which a player stands, or None if the player cannot walk."""
    # A station's fact names depend on the domain. The origin of any valid walk is the player's
    # place.
    walks = _walks(state, player)
    return walks[0].origin if walks else None


def walk_to(state: State, player: str, station: str | None) -> GroundAction | None:
    """Return a player's valid walk to a station, or None."""
    return next((w for w in _walks(state, player) if w.destination == station), None)


def walks_aside(state: State, player: str) -> list[GroundAction]:
    """Return a player's walks to empty plain stations, else to plain ones.

    Return no walk if the player stands at an empty plain station.
    """
    empty = _plain_and_empty(state)
    walks = _walks(state, player)
    if walks and walks[0].origin in empty:
        return []
    # Stations with a purpose or an object are where other players probably want to go.
    aside = [walk for walk in walks if walk.destination in empty]
    return aside or [walk for walk in walks if walk.destination in state.world.floor.plain]


def walks_out_of_the_way(state: State, player: str) -> list[GroundAction]:
    """Return the walks of `walks_aside` that lead to empty plain stations."""
    empty = _plain_and_empty(state)
    return [walk for walk in walks_aside(state, player) if walk.destination in empty]


def _plain_and_empty(state: State) -> frozenset[str]:
    """Return the plain stations without objects."""
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
    """Return whether a player stands at an empty plain station."""
    return standing_at(state, player) is not None and not walks_aside(state, player)


def seat_out_of_the_way(state: State) -> str:
    """Return the first player who is out of the way, else the first player.

    This seat suits a person who may stand still for a long time.
    """
    players = state.world.players
    return next((p for p in players if is_out_of_the_way(state, p)), players[0])


def leads_to(action: GroundAction, stations: Collection[str | None]) -> bool:
    """Return whether an action is a walk to one of these stations."""
    return action.destination is not None and action.destination in stations
