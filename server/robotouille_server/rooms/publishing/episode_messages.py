"""Messages about an episode that are the same for all recipients."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, cast
from weakref import WeakKeyDictionary

from robotouille.domain.task import Task
from robotouille.episode import ActionAnswer, Episode, Outcome, PlayedMove, Stepped
from robotouille.protocol import messages
from robotouille.protocol.codec import Codec, Fields
from robotouille.protocol.states import RankedStateWriter, StateWriter, unmet_rows, why_rows
from robotouille.replay.recorder import HASH_EVERY
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.public_task import public_task
from robotouille.world.sight import Seen
from robotouille.world.world import State, World
from robotouille_server.transport import frame_of


class EpisodeMessages:
    """Creates the messages of an episode, and their parts."""

    __slots__ = ("_episode", "_id", "_now", "_seat_number", "_writer")

    def __init__(
        self, episode_id: str, episode: Episode, writer: StateWriter, now: Callable[[], float]
    ) -> None:
        self._id = episode_id
        self._episode = episode
        self._writer = writer
        self._now = now
        self._seat_number = {player: i for i, player in enumerate(episode.world.players)}

    # Current state

    @property
    def pause(self) -> messages.Pause | None:
        """Reason of the current pause; None while the episode is not paused."""
        shown = self._episode.pauses.shown if self._episode.paused else None
        if shown is None:
            return None
        why, until = shown
        left = None if until is None else round(max(0.0, until - self._now()), 3)
        return messages.Pause(reason=why.value, left=left)

    @property
    def starts_in(self) -> float | None:
        """Seconds until the end of the countdown; None without a countdown."""
        starts_at = self._episode.starts_at
        return None if starts_at is None else round(max(0.0, starts_at - self._now()), 3)

    def seats(self, latency: Mapping[str, int]) -> list[messages.SeatInfo]:
        """Return the seats as everybody sees them.

        Args:
            latency: The round trip to each player's participant, in milliseconds.
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
        """Return the message about the end of the episode."""
        episode = self._episode
        row = cast("messages.OutcomeRow", self.outcome(outcome))
        return messages.Ended(step=episode.step, outcome=row, hash=episode.state.digest)

    def outcome(self, outcome: Outcome) -> dict[str, Any]:
        """Return the outcome as everybody sees it.

        The waits of seats with a disguised kind count as idle, as in `shown_waits`.
        """
        seats = self._episode.seats
        shown = [t.without_waits() if seats[t.player].disguised else t for t in outcome.seats]
        return replace(outcome, seats=tuple(shown)).to_json()

    # Steps

    def delta(self, event: Stepped) -> dict[str, Any]:
        """Return the fields of a `delta` message."""
        # The delta is a plain dictionary, because validating a message would take longer than the
        # step.
        delta: dict[str, Any] = {"type": "delta", "step": event.step}
        delta |= self._writer.changes(event.before, event.state)
        if event.moves:
            delta["did"] = self.did(event.moves)
            delta["seq"] = [move.seq for move in event.moves]
        if event.waits and (waits := self.shown_waits(event.waits)):
            delta["waits"] = waits
        if unmet := unmet_rows(event.attempts):
            delta["unmet"] = unmet
            delta["why"] = why_rows(event.attempts)
        if event.turn is not None:
            delta["turn"] = event.turn
        # A client with a wrong replica notices it within `HASH_EVERY` steps and asks for a
        # snapshot.
        if event.step % HASH_EVERY == 0:
            delta["hash"] = self._writer.digest(event.state)
        return delta

    def did(self, moves: Iterable[PlayedMove]) -> list[list[int | str]]:
        """Return the rows of a joint action."""
        number = self._seat_number
        return [[number[m.player], m.action.name, *m.action.arguments] for m in moves]

    def shown_waits(self, waits: Iterable[str]) -> list[int]:
        """Return the numbers of seats that wait.

        Seats with a disguised kind are left out: almost only bots announce that they wait, so
        participants would recognise them. Seats that are shown as what they are, are left out too:
        their waits would reveal that.
        """
        seats = self._episode.seats
        return [self._seat_number[player] for player in waits if not seats[player].disguised]

    def observation(
        self, player: str | None, state: State, step: int, turn: str | None, phase: str
    ) -> messages.Observation:
        """Return the text view of a state for a player, or for spectators."""
        answer = self._episode.seats[player].answer if player else ActionAnswer(0, 0)
        sight = self._episode.record.sight
        text, actions = "", tuple[GroundAction, ...]()
        if player is None:
            text = state.text_view()
        elif sight is None:
            text, actions = state.text_view(player), state.actions(player)
        else:
            seen = self._episode.record.seen(state, (player,), sight)
            text, actions = seen.text_view(player), seen.actions
        return messages.Observation(
            episode=self._id,
            step=step,
            phase=phase,
            seat=player,
            text=text,
            actions=[action.sentence for action in actions],
            turn=turn,
            seq=answer.seq,
            reasons=list(answer.reasons),
        )


_tasks: WeakKeyDictionary[World, dict[tuple[Codec, bool], Fields]] = WeakKeyDictionary()
"""Encoded tasks by world. They are the longest part of a snapshot and equal in all its episodes."""
_public: WeakKeyDictionary[World, Task] = WeakKeyDictionary()
"""Tasks for players with limited sight, by world."""


def sent_task(world: World, *, limited: bool) -> Task:
    """Return the task that clients receive, with limited sight or without."""
    if not limited:
        return world.task
    if world not in _public:
        _public[world] = public_task(world)
    return _public[world]


class Snapshots:
    """Creates the frames of `snapshot` messages. Parts that are equal for all are encoded once."""

    __slots__ = ("_episode", "_id", "_packed", "_ranked", "_state", "_step", "_writer")

    def __init__(self, episode_id: str, episode: Episode, writer: StateWriter) -> None:
        self._id = episode_id
        self._episode = episode
        self._writer = writer
        self._ranked = RankedStateWriter(episode.world)
        self._state: State | None = None
        self._step = 0
        self._packed: dict[Codec, Fields] = {}

    def frame(
        self, codec: Codec, own: dict[str, Any], *, with_task: bool, seen: Seen | None = None
    ) -> bytes:
        """Return a snapshot of the current state.

        Args:
            codec: The codec of the recipient.
            own: The recipient's own fields.
            with_task: True if the recipient lacks the task.
            seen: The part of the state that the recipient sees, if its sight is limited.
        """
        # Encoded fields are joined as bytes: two hundred clients that return together share one
        # encoding of the state.
        state = (
            self._of_state(codec) if seen is None else codec.pack_fields(self._seen_fields(seen))
        )
        parts = [state, codec.pack_fields(own)]
        if with_task:
            parts.append(self._of_task(codec, limited=seen is not None))
        return frame_of(codec.join(parts))

    def forget(self) -> None:
        """Drop the encoded state after a change."""
        self._state = None
        self._packed.clear()

    def _of_state(self, codec: Codec) -> Fields:
        episode = self._episode
        # The step is also compared, because a step may leave the state unchanged.
        if self._state is not episode.state or self._step != episode.step:
            self.forget()
            self._state, self._step = episode.state, episode.step
        fields = self._packed.get(codec)
        if fields is None:
            digest = self._writer.digest(episode.state)
            packed = codec.pack_fields(self._state_fields(episode.state, digest, limited=False))
            fields = self._packed[codec] = packed
        return fields

    def _seen_fields(self, seen: Seen) -> dict[str, Any]:
        state = seen.state
        fields = self._state_fields(state, state.digest, limited=True)
        return {**fields, "hidden": list(seen.hidden)}

    def _state_fields(self, state: State, digest: str, *, limited: bool) -> dict[str, Any]:
        episode = self._episode
        writer = self._ranked if limited else self._writer
        return {
            "type": "snapshot",
            "episode": self._id,
            "step": episode.step,
            "digest": sent_task(episode.world, limited=limited).digest,
            "hash": digest,
            "clock": episode.rules.model_dump(mode="json"),
            **writer.tables(state),
            **writer.values(state),
        }

    def _of_task(self, codec: Codec, *, limited: bool) -> Fields:
        world = self._episode.world
        packed = _tasks.setdefault(world, {})
        key = codec, limited
        if key not in packed:
            packed[key] = codec.pack_fields({"task": sent_task(world, limited=limited).json})
        return packed[key]


def last_seq(episode: Episode, players: Collection[str]) -> int:
    """Return the highest sequence number that these seats have sent."""
    return max((episode.seats[player].seq for player in players), default=0)


def own_answers(episode: Episode, players: Collection[str]) -> dict[str, Any]:
    """Return the fields with the result of the last action of each of a participant's seats."""
    answers = [_answer_row(player, episode.seats[player].answer) for player in players]
    first = answers[0] if answers else {}
    return {
        "seat": first.get("seat"),
        "seq": last_seq(episode, players),
        "last_seq": first.get("seq", 0),
        "last_step": first.get("step", 0),
        "last_reasons": first.get("reasons", []),
        "answers": answers[1:],
    }


def _answer_row(player: str, answer: ActionAnswer) -> dict[str, Any]:
    seat_answer = messages.SeatAnswer(
        seat=player, seq=answer.seq, step=answer.step, reasons=list(answer.reasons)
    )
    return seat_answer.model_dump(mode="json", exclude_defaults=True)
