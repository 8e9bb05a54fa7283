"""Who waits for a place, and who stands there: told by what is asked for and what was refused."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from robotouille.planning.policies.team_talk import requested
from robotouille.world.people.occupancy import Occupancy
from robotouille.world.people.wording import Wording
from robotouille.world.scene import Placed, scene
from robotouille.world.unmet import Unmet
from robotouille.world.world import State

__all__ = ["Blockages"]

SECONDS = 5.0
"""For how long somebody is taken to wait, unless the place becomes free before."""


class Blockages:
    """Keeps who waits for which station, for a while."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._waits: dict[tuple[str, str], float] = {}

    def said(self, player: str, text: str, state: State, wording: Wording) -> None:
        """Somebody says something: it may ask for places at which others stand."""
        for other, station in _standing(scene(state)):
            if player and other != player and requested(text, station, state, wording):
                self._waits[player, station] = self._now() + SECONDS

    def refused(self, player: str, unmet: Iterable[Unmet], state: State) -> None:
        """Somebody could not do something: it may be that another stands there."""
        rules = Occupancy(state.world)
        for each in unmet:
            station = rules.needed_free(each)
            if station is not None and {*rules.players_at(state, station)} - {player}:
                self._waits[player, station] = self._now() + SECONDS

    def at(self, state: State) -> tuple[tuple[str, str, str], ...]:
        """Who is blocked in a state: the player, the station, and who stands there."""
        now = self._now()
        self._waits = {wait: until for wait, until in self._waits.items() if until > now}
        if not self._waits:
            return ()
        by = {station: player for player, station in _standing(scene(state))}
        return tuple(
            (player, station, by[station])
            for player, station in self._waits
            if by.get(station, player) != player
        )


def _standing(placed: dict[str, Placed]) -> list[tuple[str, str]]:
    return [(name, each.at) for name, each in placed.items() if each.at is not None]
