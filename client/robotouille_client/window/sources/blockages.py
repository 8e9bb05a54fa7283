"""Who waits for whom, or for a place where somebody stands: told by what is asked for, by who says
in each step that they wait, and by what was refused."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

from robotouille.planning.policies.team_talk import appealed, requested
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.occupancy import Occupancy
from robotouille.world.people.wording import Wording
from robotouille.world.scene import Placed, scene
from robotouille.world.unmet import Unmet
from robotouille.world.world import State

__all__ = ["Blockages"]

SECONDS = 5.0
"""For how long somebody is taken to wait, unless the place becomes free before."""
ASKED_SECONDS = 30.0
"""The same of somebody who has asked for something, and neither acts nor says that they wait."""


@dataclass(frozen=True, slots=True)
class _Wish:
    """What somebody has asked `whom` for: to leave a station, or, without one, to do something.
    `stood` is where they stood then, or where they have said since that they wait."""

    station: str
    whom: str
    until: float
    stood: str | None


class Blockages:
    """Keeps who waits for which station or for whom, for as long as they do."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._waits: dict[tuple[str, str], float] = {}
        self._wishes: dict[str, tuple[_Wish, ...]] = {}

    def said(self, player: str, text: str, state: State, wording: Wording) -> None:
        """Somebody says something: it may ask for places at which others stand, or others to do
        something."""
        placed = scene(state)
        if player not in placed:
            return
        asked = [
            (station, other)
            for other, station in _standing(placed)
            if other != player and requested(text, station, state, wording)
        ]
        if not asked:
            whom = appealed(text, player, state, wording)
            asked = [] if whom is None else [("", whom)]
        if asked:
            until, stood = self._now() + ASKED_SECONDS, placed[player].at
            self._wishes[player] = tuple(_Wish(*each, until, stood) for each in asked)

    def refused(self, player: str, unmet: Iterable[Unmet], state: State) -> None:
        """Somebody could not do something: it may be that another stands there."""
        rules = Occupancy(state.world)
        for each in unmet:
            station = rules.needed_free(each)
            if station is not None and {*rules.players_at(state, station)} - {player}:
                self._waits[player, station] = self._now() + SECONDS

    def stepped(
        self,
        did: Iterable[tuple[str, GroundAction | None, bool]],
        waits: Collection[str],
        state: State,
    ) -> None:
        """A step was taken: who acted, and whether that applied; who said that they wait.

        Who waits goes on to wait for what they have asked for, wherever they stand; who does
        something else than walk does not.
        """
        placed, until = scene(state), self._now() + ASKED_SECONDS
        for player, action, applied in did:
            if applied and action is not None and action.destination is None:
                self._wishes.pop(player, None)
        for player in {*waits} & self._wishes.keys():
            self._wishes[player] = tuple(
                replace(wish, until=until, stood=placed[player].at) for wish in self._wishes[player]
            )

    def at(self, state: State) -> tuple[tuple[str, str, str], ...]:
        """Who is held up in a state: the player, the station, and who stands there; no station
        where it is something that the other is to do."""
        now = self._now()
        self._waits = {wait: until for wait, until in self._waits.items() if until > now}
        if not (self._waits or self._wishes):
            return ()
        placed = scene(state)
        by = {station: player for player, station in _standing(placed)}
        self._wishes = {
            player: tuple(
                wish
                for wish in wishes
                if wish.until > now and by.get(wish.station, wish.whom) != player
                and (not wish.station or wish.station in by)
            )
            for player, wishes in self._wishes.items()
        }  # fmt: skip
        self._wishes = {player: wishes for player, wishes in self._wishes.items() if wishes}
        found = dict.fromkeys(
            (player, wish.station, by.get(wish.station, wish.whom))
            for player, wishes in self._wishes.items()
            for wish in wishes
            if placed[player].at == wish.stood
        )
        refused = ((player, station, by.get(station, player)) for player, station in self._waits)
        found.update(dict.fromkeys(one for one in refused if one[0] != one[2]))
        return tuple(found)


def _standing(placed: dict[str, Placed]) -> list[tuple[str, str]]:
    return [(name, each.at) for name, each in placed.items() if each.at is not None]
