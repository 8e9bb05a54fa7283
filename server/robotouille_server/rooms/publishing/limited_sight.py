"""Messages for players who see a part of the kitchen (docs/decisions/0056)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from pydantic import BaseModel

from robotouille.episode import Episode, Stepped
from robotouille.protocol import messages
from robotouille.protocol.states import RankedStateWriter, unmet_rows, why_rows
from robotouille.world.sight import Seen, Sight, told
from robotouille.world.unmet import Attempt
from robotouille.world.world import State
from robotouille_server.rooms.publishing.episode_messages import EpisodeMessages


class LimitedSight:
    """Creates what the players of an episode receive, if their sight is limited.

    Everything depends only on the states before and after a step, so a player's client that keeps
    what it received has exactly what its players see now.
    """

    __slots__ = ("_episode", "_messages", "_sight", "_writer")

    def __init__(self, episode: Episode, sight: Sight, common: EpisodeMessages) -> None:
        self._episode = episode
        self._sight = sight
        self._messages = common
        # The episode's own writer keeps the last changes of the whole state for the recording.
        self._writer = RankedStateWriter(episode.world)

    def seen(self, state: State, players: tuple[str, ...]) -> Seen:
        """Return what the players of one participant see of a state."""
        return self._episode.record.seen(state, players, self._sight)

    def delta(self, event: Stepped, players: tuple[str, ...]) -> dict[str, Any]:
        """Return the fields of a `delta` message for the participant who plays these seats."""
        before, after = self.seen(event.before, players), self.seen(event.state, players)
        delta: dict[str, Any] = {"type": "delta", "step": event.step}
        # There is no hash: effects that come into sight again are in another order in the client.
        delta |= self._writer.changes(before.state, after.state)
        throughout = before.things & after.things
        shown = [
            (move, attempt if attempt.applied else _told(attempt, throughout))
            for move, attempt in zip(event.moves, event.attempts, strict=True)
            if move.player in players
            or throughout.issuperset((move.player, *move.action.arguments))
        ]
        if shown:
            delta["did"] = self._messages.did(move for move, _ in shown)
            delta["seq"] = [move.seq for move, _ in shown]
        delta |= _rejections([attempt for _, attempt in shown])
        waits = [p for p in event.waits if p in players or p in throughout]
        if waits and (numbers := self._messages.shown_waits(waits)):
            delta["waits"] = numbers
        if event.turn is not None:
            delta["turn"] = event.turn
        if before.hidden != after.hidden:
            delta["hidden"] = list(after.hidden)
        return delta

    def shown(self, message: BaseModel, players: tuple[str, ...]) -> BaseModel:
        """Return a message without what the participant who plays these seats does not see."""
        if isinstance(message, messages.Roster):
            things = self.seen(self._episode.state, players).things
            waits_for = [p for p in message.waits_for if p in players or p in things]
            seats = self.seats(message.seats, players)
            return message.model_copy(update={"seats": seats, "waits_for": waits_for})
        if isinstance(message, messages.Ended):
            return message.model_copy(update={"hash": ""})
        return message

    def seats(
        self, seats: Sequence[messages.SeatInfo], players: Collection[str]
    ) -> list[messages.SeatInfo]:
        """Return the seats without the numbers of actions of others."""
        unknown = {"acted": 0, "rejected": 0}
        return [s if s.player in players else s.model_copy(update=unknown) for s in seats]


def _told(attempt: Attempt, things: Collection[str]) -> Attempt:
    return attempt._replace(unmet=told(attempt.unmet, things))


def _rejections(attempts: Sequence[Attempt]) -> dict[str, Any]:
    unmet = unmet_rows(attempts)
    return {"unmet": unmet, "why": why_rows(attempts)} if unmet else {}
