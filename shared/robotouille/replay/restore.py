"""Recordings back to episodes, which go on after their process stopped."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from robotouille.domain.task import Task
from robotouille.episode import (
    ActionAnswer,
    Episode,
    Moderation,
    Move,
    Outcome,
    PauseReason,
    Phase,
    RecoveredEpisode,
    Rules,
    Seat,
    SeatTreatment,
)
from robotouille.episode.events import ACTION_INVALID
from robotouille.episode.quota import NOTE_BYTES, Quota, size_of_note, size_of_rejection
from robotouille.errors import RecordingError
from robotouille.replay.notes import controller_after, rejection_kind
from robotouille.replay.recording import Comparison, Recording
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World

__all__ = ["Restored", "restore", "restoring"]


@dataclass(frozen=True, slots=True)
class Restored:
    """An episode as its recording leaves it.

    Of the file the first `kept` bytes hold; `missing` has to be appended to them before anything
    else. `said` are the chat messages so far. A recording that is `complete` has its outcome and
    only needs to be closed.
    """

    episode: Episode
    kept: int
    missing: bytes
    said: tuple[dict[str, Any], ...]
    complete: bool


def restore(
    recording: Recording,
    now: float,
    patience: float,
    world_of: Callable[[Task], World] = World,
) -> Restored:
    """The episode of a recording that was cut off anywhere behind its header.

    Everybody who was present is waited for, for `patience` seconds. Raises RecordingError where
    the recording does not re-simulate.
    """
    steps = restoring(recording, now, patience, world_of)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: Restored = end.value
            return found
        except _DifferentError:
            fault = recording.verify().fault or "its frames are not those that play writes now"
            raise RecordingError(f"{recording.source}: {fault}") from None


class _DifferentError(RecordingError):
    """The recording does not re-simulate."""


def restoring(
    recording: Recording,
    now: float,
    patience: float,
    world_of: Callable[[Task], World] = World,
) -> Generator[None, None, Restored]:
    """The same frame by frame, for those who have something else to do in between."""
    recording.world = world_of(recording.task)
    comparison = Comparison(recording)
    treatments = _treatments(recording)
    episode = RecoveredEpisode(recording.world, _rules(recording), now, treatments=treatments)
    replayer = _Replayer(episode)
    for frame, _, written in recording.anew():
        comparison.add(written)
        if not comparison.same:
            raise _DifferentError(f"{recording.source}: it does not re-simulate")
        replayer.frame(recording, frame)
        yield
    if not comparison.reaches_the_end:
        raise _DifferentError(f"{recording.source}: it does not re-simulate")
    outcome = recording.outcome
    if outcome is not None:
        episode.restore_ended(_outcome(recording, outcome))
    else:
        episode.resume_after_restart(
            now,
            elapsed=replayer.milliseconds / 1000,
            patience=patience,
            expected=replayer.expected,
            paused=PauseReason.OPERATOR in replayer.pauses,
        )
    missing, said = comparison.missing, tuple(replayer.said)
    return Restored(episode, recording.whole, missing, said, outcome is not None)


def _outcome(recording: Recording, row: dict[str, Any]) -> Outcome:
    try:
        return Outcome.from_json(row)
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{recording.source}: the outcome: {error}") from None


def _rules(recording: Recording) -> Rules:
    try:
        return Rules.model_validate(recording.header["rules"], strict=False)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        raise RecordingError(f"{recording.source}: rules.{field}: {first['msg']}") from None


def _treatments(recording: Recording) -> dict[str, SeatTreatment]:
    """What was done to seats; the frame's schema has checked it."""
    rows = recording.header.get("treatments", {})
    return {player: SeatTreatment.model_validate(row) for player, row in rows.items()}


class _Replayer:
    """Goes through the frames of a recording and brings an episode to where they end."""

    def __init__(self, episode: RecoveredEpisode) -> None:
        self.episode = episode
        self.milliseconds = 0
        self.said: list[dict[str, Any]] = []
        self.pauses: list[str] = []
        self.expected: set[str] = set()

    def frame(self, recording: Recording, frame: dict[str, Any]) -> None:
        if frame["kind"] == "step":
            actions = recording.actions(frame)
            self.milliseconds = max(self.milliseconds, frame["t"])
            self._check_players(frame)
            moves = [
                _move(row, action) for row, action in zip(frame["moves"], actions, strict=True)
            ]
            for move in moves:
                self.episode.seats[move.player].quota.take(len(move.reasoning.encode()))
            idle = [(str(player), int(seq)) for player, seq in frame.get("idle", ())]
            undone = [tuple(atom) for atom in frame.get("undone", ())]
            waits = frame.get("waits", ())
            self.episode.replay_step(moves, idle, undone, waits, time=frame["t"] / 1000)
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                self.milliseconds = max(self.milliseconds, note["t"])
                self._note(note)

    def _note(self, note: dict[str, Any]) -> None:
        match note["note"]:
            case "roster":
                self.episode.used = True
                _sit(self._seat(note), note, self.episode.ran(note["t"] / 1000))
                if note["present"] or not note.get("taken", True):
                    self.expected.discard(note["player"])
            case "ready":
                self._seat(note).ready = note["ready"]
            case "rejected":
                self._rejected(self._seat(note), note)
            case "said":
                self.said.append(note)
                self.episode.said += 1
                size = NOTE_BYTES + len(note["name"].encode()) + len(note["text"].encode())
                self._quota(note).take(size)
                if note["player"]:
                    self._seat(note).tally.said += 1
            case "noted":
                self._seat(note).quota.take(size_of_note(note["topic"], note["text"]))
            case "quota":
                self._quota(note).reached = True
            case "moderated":
                what = Moderation(note["what"])
                self.episode.replay_moderation(what, note["session"], note["participant"])
            case "paused":
                self.pauses = note["holds"]
                self.episode.replay_pause(note["t"] / 1000)
            case "resumed":
                self.pauses = []
                self.episode.replay_resume(note["t"] / 1000)
            case "restarted":
                seats = self.episode.seats.values()
                self.expected |= {seat.player for seat in seats if seat.present}
            case "started" if self.episode.phase is Phase.WAITING:
                self.episode.replay_start()

    def _rejected(self, seat: Seat, note: dict[str, Any]) -> None:
        reasons, code = tuple(note["reasons"]), note.get("code", ACTION_INVALID)
        if note.get("heard", True):
            seat.seq = max(seat.seq, note["seq"])
            seat.answer = ActionAnswer(note["seq"], self.episode.step, reasons, code)
        seat.count_rejection(rejection_kind(note))
        texts = [note["action"], note.get("text", ""), *reasons]
        for why in note.get("why", ()):
            texts += [why.get("predicate", ""), *why.get("objects", ())]
        seat.quota.take(size_of_rejection(texts))
        seat.quota.take(len(note.get("reasoning", "").encode()))

    def _quota(self, note: dict[str, Any]) -> Quota:
        """The quota of a seat, or that of all spectators."""
        return self._seat(note).quota if note["player"] else self.episode.audience_quota

    def _check_players(self, frame: dict[str, Any]) -> None:
        players = [row["player"] for row in frame["moves"]]
        players += [player for player, _ in frame.get("idle", ())]
        for player in players:
            if player not in self.episode.seats:
                raise RecordingError(f"step {frame['step']} speaks of a seat {player!r}")

    def _seat(self, note: dict[str, Any]) -> Seat:
        try:
            return self.episode.seats[note["player"]]
        except KeyError:
            raise RecordingError(f"a note speaks of a seat {note['player']!r}") from None


def _move(row: dict[str, Any], action: GroundAction) -> Move:
    told = row.get("reasoning", ""), row.get("basis")
    return Move(row["player"], action, row["seq"], row["ms"] / 1000, *told)


def _sit(seat: Seat, note: dict[str, Any], ran: float) -> None:
    """A seat as a roster note leaves it, once the game has run for so many seconds."""
    if note.get("taken", True):
        newcomer = not seat.taken or seat.session != note.get("session", "")
        if newcomer:
            if seat.taken:
                seat.vacate(ran)
            session, participant = note.get("session", ""), note.get("participant", "")
            seat.take(note["name"], note["kind"], session, participant, ran)
        seat.generation = note.get("generation", 0)
        if note["present"]:
            seat.come_back(ran)
        elif seat.present:
            seat.lose_connection(ran)
    elif seat.taken:
        seat.vacate(ran)
    seat.controller = controller_after(note)
