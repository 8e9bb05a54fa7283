"""What is said of an episode, the same to everybody: messages, but not to whom they go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

from robotouille.episode import ActionAnswer, Episode, Outcome, Stepped
from robotouille.protocol import messages
from robotouille.protocol.states import StateWriter, unmet_rows, why_rows
from robotouille.replay.recorder import HASH_EVERY
from robotouille.world.world import State

__all__ = ["EpisodeMessages"]


class EpisodeMessages:
    """Makes the messages of an episode, and their parts."""

    __slots__ = ("_episode", "_id", "_now", "_seat_number", "_writer")

    def __init__(
        self, episode_id: str, episode: Episode, writer: StateWriter, now: Callable[[], float]
    ) -> None:
        self._id = episode_id
        self._episode = episode
        self._writer = writer
        self._now = now
        self._seat_number = {player: i for i, player in enumerate(episode.world.players)}

    # How it stands

    @property
    def pause(self) -> messages.Pause | None:
        """Why a game that has begun stands still; None while it does not."""
        shown = self._episode.pauses.shown if self._episode.paused else None
        if shown is None:
            return None
        why, until = shown
        left = None if until is None else round(max(0.0, until - self._now()), 3)
        return messages.Pause(reason=why.value, left=left)

    @property
    def starts_in(self) -> float | None:
        """The seconds until the game begins, while that is counted down."""
        starts_at = self._episode.starts_at
        return None if starts_at is None else round(max(0.0, starts_at - self._now()), 3)

    def seats(self, latency: Mapping[str, int]) -> list[messages.SeatInfo]:
        """The seats as everybody is told them.

        Args:
            latency: The milliseconds that a message takes to their participants and back.
        """
        return [
            messages.SeatInfo(
                player=seat.player,
                name=seat.name,
                kind=seat.shown_kind,
                present=seat.present,
                controller=seat.shown_controller.value,
                acted=seat.tally.acted,
                rejected=seat.tally.rejected,
                ready=seat.ready,
                latency_ms=latency.get(seat.player, 0),
            )
            for seat in self._episode.seats.values()
        ]

    def ended(self, outcome: Outcome) -> messages.Ended:
        """How the game ended."""
        episode = self._episode
        row = cast("messages.OutcomeRow", outcome.to_json())
        return messages.Ended(step=episode.step, outcome=row, hash=episode.state.digest)

    # Steps

    def delta(self, event: Stepped) -> dict[str, Any]:
        """The fields of a `delta` message, as plain values: it is made for every step."""
        delta: dict[str, Any] = {"type": "delta", "step": event.step}
        delta |= self._writer.changes(event.before, event.state)
        if event.moves:
            delta["did"] = [
                [self._seat_number[m.player], m.action.name, *m.action.arguments]
                for m in event.moves
            ]
            delta["seq"] = [move.seq for move in event.moves]
        if event.waits and (waits := self._shown_waits(event)):
            delta["waits"] = waits
        if unmet := unmet_rows(event.attempts):
            delta["unmet"] = unmet
            delta["why"] = why_rows(event.attempts)
        if event.turn is not None:
            delta["turn"] = event.turn
        if event.step % HASH_EVERY == 0:
            delta["hash"] = self._writer.digest(event.state)
        return delta

    def _shown_waits(self, event: Stepped) -> list[int]:
        """The seats that said that they wait. Hardly any person's program says so: it is not told
        of one who is shown as something else."""
        seats = self._episode.seats
        undisguised = [p for p in event.waits if seats[p].shown_kind == seats[p].kind]
        return [self._seat_number[player] for player in undisguised]

    def observation(
        self, player: str | None, state: State, step: int, turn: str | None, phase: str
    ) -> messages.Observation:
        """A state in words for a player's seat, or for a spectator."""
        answer = self._episode.seats[player].answer if player else ActionAnswer(0, 0)
        return messages.Observation(
            episode=self._id,
            step=step,
            phase=phase,
            seat=player,
            text=state.text_view(player),
            actions=[a.sentence for a in state.actions(player)] if player else [],
            turn=turn,
            seq=answer.seq,
            reasons=list(answer.reasons),
        )
