"""An episode that goes on from its recording, after its process stopped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from robotouille.domain.task import Task
from robotouille.episode import Answer, Controller, Episode, Move, Outcome, Rules, Seat
from robotouille.errors import RecordingError
from robotouille.replay.frames import MAGIC, pack_frame
from robotouille.replay.recording import Recording
from robotouille.world.world import World

__all__ = ["Restored", "restore"]


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
    recording.world = world_of(recording.task)
    whole = len(MAGIC) + sum(len(pack_frame(frame)) for frame in recording.frames)
    anew = recording.resimulate()
    if anew[:whole] != recording.stream[:whole]:
        fault = recording.verify().fault or "its frames are not those that play writes now"
        raise RecordingError(f"{recording.source}: {fault}")
    missing = anew[whole:]
    episode = Episode(recording.world, _rules(recording), now)
    retraced = _Retraced(episode)
    for frame in recording.frames:
        retraced.frame(recording, frame)
    outcome = recording.outcome
    if outcome is not None:
        episode.conclude(_outcome(recording, outcome))
    else:
        episode.go_on(now, elapsed=retraced.milliseconds / 1000, patience=patience)
    return Restored(episode, whole, missing, tuple(retraced.said), outcome is not None)


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


class _Retraced:
    """Goes through the frames of a recording and brings an episode to where they end."""

    def __init__(self, episode: Episode) -> None:
        self.episode = episode
        self.milliseconds = 0
        self.said: list[dict[str, Any]] = []

    def frame(self, recording: Recording, frame: dict[str, Any]) -> None:
        if frame["kind"] == "step":
            actions = recording.actions(frame)
            self.milliseconds = max(self.milliseconds, frame["t"])
            self.episode.retrace(
                Move(row["player"], action, row["seq"], row["ms"] / 1000, row.get("reasoning", ""))
                for row, action in zip(frame["moves"], actions, strict=True)
            )
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                self.milliseconds = max(self.milliseconds, note["t"])
                self._note(note)

    def _note(self, note: dict[str, Any]) -> None:
        match note["note"]:
            case "roster":
                self.episode.used = True
                _sit(self._seat(note), note)
            case "rejected":
                seat = self._seat(note)
                seat.seq = max(seat.seq, note["seq"])
                seat.answer = Answer(note["seq"], self.episode.step, tuple(note["reasons"]))
                seat.tally.rejected += 1
            case "said":
                self.said.append(note)
                self.episode.said += 1
                if note["player"]:
                    self._seat(note).tally.said += 1
            case "started":
                self.episode.retrace_start()

    def _seat(self, note: dict[str, Any]) -> Seat:
        try:
            return self.episode.seats[note["player"]]
        except KeyError:
            raise RecordingError(f"a note speaks of a seat {note['player']!r}") from None


def _sit(seat: Seat, note: dict[str, Any]) -> None:
    if note.get("taken", True):
        newcomer = not seat.taken or seat.session != note.get("session", "")
        if newcomer:
            seat.take(
                note["name"], note["kind"], note.get("session", ""), note.get("participant", ""), 0
            )
        seat.generation = note.get("generation", 0)
        seat.present = note["present"]
    else:
        seat.free()
    seat.controller = Controller(note.get("controller", ""))
