"""The round trips of participants, recorded and told to the others: looked at beside the games."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille_server.rooms.session import Session

__all__ = ["LOOK_SECONDS", "RoundTrips", "told_latency"]

LOOK_SECONDS = 10.0
"""From the end of a round to the next one."""
MIN_CHANGE, MAX_CHANGE = 0.001, 0.02
"""Seconds by which a round trip has to change at least; by which it may, before it is recorded."""
TOLD_MS = 50
"""What others are told is a multiple of this."""


class RoundTrips:
    """The round trips of one episode's seats as they were recorded last."""

    __slots__ = ("_recorded",)

    def __init__(self) -> None:
        self._recorded: dict[str, float] = {}

    def look(self, members: Iterable[Session]) -> tuple[bool, list[tuple[str, float]]]:
        """Whether others are to be told something else of any player's connection, which is noted
        in the sessions; and the round trips that are to be recorded, by player, in seconds."""
        measured = [
            (session, session.peer.latency)
            for session in members
            if session.players and session.peer is not None and session.peer.latency > 0
        ]
        before = [session.latency_ms for session, _ in measured]
        for session, seconds in measured:
            session.latency_ms = told_latency(seconds, session.latency_ms)
        told = before != [session.latency_ms for session, _ in measured]
        seats = [(player, seconds) for session, seconds in measured for player in session.players]
        return told, [seat for seat in seats if self.changed(*seat)]

    def changed(self, player: str, seconds: float) -> bool:
        """Whether one is to be recorded: it is the first, or has changed by more than a quarter or
        20 ms, and at least by 1 ms. Then it is what the next is compared with."""
        before = self._recorded.get(player)
        if before is not None:
            change = abs(seconds - before)
            if change < MIN_CHANGE or change <= min(before / 4, MAX_CHANGE):
                return False
        self._recorded[player] = seconds
        return True


def told_latency(seconds: float, told: int) -> int:
    """What others are told of a round trip, in milliseconds, where they were `told` something
    before: that again, unless it has changed by more than 50 ms and by more than a quarter."""
    milliseconds = seconds * 1000
    if abs(milliseconds - told) <= max(TOLD_MS, told / 4):
        return told
    return round(milliseconds / TOLD_MS) * TOLD_MS
