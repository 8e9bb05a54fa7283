"""Players who wait for each other, and for which place or action."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace

from robotouille.planning.policies.team_talk import appeal, appealed, requested
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Intent, Signal
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import Occupancy
from robotouille.world.scene import Placed, scene
from robotouille.world.unmet import Unmet
from robotouille.world.world import State

BLOCKED_SECONDS = 30.0
"""Time for which a rejected player counts as waiting.

It ends earlier if the station becomes free or the player does something else. It is long, because a
mark that comes and goes does not show who has to move.
"""
ASKED_SECONDS = 30.0
"""Time for which a player who asked for something counts as waiting.

It is longer because a request is deliberate, and answering it can take a walk and some work.
"""


@dataclass(frozen=True, slots=True)
class _Request:
    """Request to `whom` to leave a station or, without a station, to do something.

    `stood` is the station where the player asked, or last said to be waiting; `text` is the
    message.
    """

    station: str
    whom: str
    until: float
    stood: str | None
    text: str


@dataclass(frozen=True, slots=True)
class TakenStep:
    """One step of a game.

    Attributes:
        before: State before the step; None if it is not known.
        did: (player, action, applied) for each player.
        waits: Players that said they wait.
    """

    before: State | None
    after: State
    did: Sequence[tuple[str, GroundAction | None, bool]] = ()
    waits: Collection[str] = ()


class Blockages:
    """Players who wait for a station or for a teammate."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._waits: dict[tuple[str, str], float] = {}
        self._requests: dict[str, tuple[_Request, ...]] = {}
        self._earlier: dict[str, tuple[_Request, ...]] = {}

    def said(
        self, player: str, text: str, signal: Signal | None, state: State, wording: Wording
    ) -> None:
        """Read a chat message for requests to leave a station or to do something."""
        placed = scene(state)
        # Spectators have no place in the kitchen, so they cannot be held up.
        if player not in placed:
            return
        asked = [
            (station, other)
            for other, station in _standing(placed)
            if other != player and _asks_for(station, text, signal, state, wording)
        ]
        # A station says precisely what is needed; a name alone only says from whom.
        if not asked:
            whom = appealed(text, player, state, wording)
            asked = [] if whom is None else [("", whom)]
        if asked:
            until, stood = self._now() + ASKED_SECONDS, placed[player].at
            self._requests[player] = tuple(_Request(*each, until, stood, text) for each in asked)

    def refused(self, player: str, unmet: Iterable[Unmet], state: State) -> None:
        """Read the reasons of a rejected action for a station that another player occupies."""
        rules = Occupancy(state.world)
        for each in unmet:
            # The occupant may have left in the same step. Then nobody is in the way any more.
            station = rules.needed_free(each)
            if station is not None and {*rules.players_at(state, station)} - {player}:
                self._waits[player, station] = self._now() + BLOCKED_SECONDS

    def stepped(self, step: TakenStep, wording: Wording) -> None:
        """Update requests after a step."""
        placed, now = scene(step.after), self._now()
        self._settle(step, wording)
        # A player who works at something does not need the request now. A walk alone proves
        # nothing: players step aside while they wait.
        for player, action, applied in step.did:
            if applied and action is not None:
                self._waits = {wait: t for wait, t in self._waits.items() if wait[0] != player}
                if action.destination is None and player in self._requests:
                    self._earlier[player] = self._requests.pop(player)
        # Bots that wait say so in each step, which renews their requests. They do not ask again
        # after other work.
        for player in {*step.waits} & self._earlier.keys():
            again = tuple(each for each in self._earlier.pop(player) if each.until > now)
            self._requests.setdefault(player, again)
        for player in {*step.waits} & self._requests.keys():
            self._requests[player] = tuple(
                replace(each, until=now + ASKED_SECONDS, stood=placed[player].at)
                for each in self._requests[player]
            )

    def _settle(self, step: TakenStep, wording: Wording) -> None:
        """Remove the requests to do what has been done in a step."""
        before, made = step.before, (self._requests, self._earlier)
        if before is None or not any(made):
            return
        # Whoever does it, nobody has to do it any more.
        done = {
            appeal(action, before, wording).casefold()
            for _, action, applied in step.did
            if applied and action is not None
        }
        for requests in made:
            for player, found in requests.items():
                requests[player] = tuple(e for e in found if e.text.casefold() not in done)

    def at(self, state: State) -> tuple[tuple[str, str, str], ...]:
        """Return (player, station, occupant) for each player who waits in a state.

        The station is empty if the player waits for a teammate to do something.
        """
        now = self._now()
        self._waits = {wait: until for wait, until in self._waits.items() if until > now}
        # This runs in every frame. In most frames no player waits, so skip computing the scene.
        if not (self._waits or self._requests):
            return ()
        placed = scene(state)
        by = {station: player for player, station in _standing(placed)}
        self._requests = {
            player: tuple(
                each
                for each in requests
                if each.until > now and by.get(each.station, each.whom) != player
                and (not each.station or each.station in by)
            )
            for player, requests in self._requests.items()
        }  # fmt: skip
        self._requests = {player: found for player, found in self._requests.items() if found}
        # A player who walked away after asking is not shown as waiting.
        found = dict.fromkeys(
            (player, each.station, by.get(each.station, each.whom))
            for player, requests in self._requests.items()
            for each in requests
            if placed[player].at == each.stood
        )
        refused = ((player, station, by.get(station, player)) for player, station in self._waits)
        found.update(dict.fromkeys(one for one in refused if one[0] != one[2]))
        return tuple(found)


def _asks_for(
    station: str, text: str, signal: Signal | None, state: State, wording: Wording
) -> bool:
    if signal is None:
        return requested(text, station, state, wording)
    return signal == Signal(Intent.NEED, station)


def _standing(placed: dict[str, Placed]) -> list[tuple[str, str]]:
    return [(name, each.at) for name, each in placed.items() if each.at is not None]
