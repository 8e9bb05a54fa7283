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
ASKED_SECONDS = 30.0
"""The same of somebody who has asked for the place, and stands still since."""


class Blockages:
    """Keeps who waits for which station, for a while."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._waits: dict[tuple[str, str], float] = {}
        self._asked: dict[tuple[str, str], tuple[float, str | None]] = {}

    def said(self, player: str, text: str, state: State, wording: Wording) -> None:
        """Somebody says something: it may ask for places at which others stand."""
        placed, now = scene(state), self._now()
        for other, station in _standing(placed):
            if player and other != player and requested(text, station, state, wording):
                self._waits[player, station] = now + SECONDS
                self._asked[player, station] = now + ASKED_SECONDS, placed[player].at

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
        self._asked = {wait: told for wait, told in self._asked.items() if told[0] > now}
        if not (self._waits or self._asked):
            return ()
        placed = scene(state)
        by = {station: player for player, station in _standing(placed)}
        self._asked = {
            (player, station): (until, stood)
            for (player, station), (until, stood) in self._asked.items()
            if placed[player].at == stood and by.get(station, player) != player
        }
        return tuple(
            (player, station, by[station])
            for player, station in dict.fromkeys((*self._waits, *self._asked))
            if by.get(station, player) != player
        )


def _standing(placed: dict[str, Placed]) -> list[tuple[str, str]]:
    return [(name, each.at) for name, each in placed.items() if each.at is not None]
