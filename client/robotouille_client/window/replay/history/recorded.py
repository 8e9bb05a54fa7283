"""The history of a recording, by one pass through its frames."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.episode import Controller, RejectionKind
from robotouille.episode.tallies import Activity
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.planning.policies.team_talk import announced_version
from robotouille.replay.analysis.activities import activities
from robotouille.replay.container import MAGIC, frame_ends, frame_value
from robotouille.replay.controllers import Seating, seating_after
from robotouille.replay.notes import rejection_kind
from robotouille.replay.recording import Recording
from robotouille.replay.timeline import interludes, note_words
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, Step, World
from robotouille_client.window.replay.history.history import (
    Entry,
    EntryKind,
    History,
    recorded_rate,
)
from robotouille_client.window.replay.history.recorded_states import RecordedStates
from robotouille_client.window.replay.history.spoken import Spoken
from robotouille_client.window.sources.texts import outcome_words
from robotouille_client.window.view import SeatView

__all__ = ["RecordedHistory"]

NOT_PRESENT = (Controller.FREE, Controller.ABSENT, Controller.STAND_IN)
_KINDS = {
    "rejected": EntryKind.REJECTED,
    "said": EntryKind.SAID,
    "noted": EntryKind.REASONING,
    "roster": EntryKind.SEAT,
    "paused": EntryKind.PAUSED,
    "restarted": EntryKind.RESTARTED,
    "announced": EntryKind.ANNOUNCED,
}
MAX_KEPT = 256
"""Steps whose entries are kept in words."""
_TOLD = frozenset({"paused", "resumed", "restarted", "announced"})
"""Notes that interludes are made of."""


@dataclass(slots=True)
class _ToldNotes:
    """Those notes that interludes are made of."""

    outcome: dict[str, Any] | None
    kept: list[dict[str, Any]] = field(default_factory=list)

    def notes(self) -> Iterator[dict[str, Any]]:
        return iter(self.kept)


class RecordedHistory(History):
    """A recording; where its frames make no sense any more, `fault` says so, and it ends there.

    Its log is in the words of the domain, with `words` laid over them.
    """

    def __init__(self, recording: Recording, words: Language = NO_WORDS) -> None:
        super().__init__(recording.world)
        self.recording = recording
        self.max_steps = recording.header["rules"]["max_steps"]
        self.rate = recorded_rate(recording.header["rules"])
        self.states = RecordedStates(recording.world, recording.stream, recording.header["tables"])
        self._stand_in = str(recording.header["rules"].get("stand_in", "bot"))
        self._seatings: dict[str, Seating] = dict.fromkeys(self.world.players, Seating())
        self._seated: dict[str, tuple[str, str]] = {}
        self._seatings_from = [0]
        self._seatings_by_step = [self._seatings]
        self._rejected = {player: array("q") for player in self.world.players}
        self._notes: dict[int, list[tuple[Entry, dict[str, Any] | None]]] = defaultdict(list)
        self._spoken = Spoken(self.world, language_of(self.world.task).with_words(words))
        self._kept: dict[int, tuple[Entry, ...]] = {}
        self._told = _ToldNotes(recording.outcome)
        self.fault = recording.damage
        self._read()
        self.interludes = interludes(self._told)

    @property
    def outcome(self) -> Mapping[str, object] | None:
        return self.recording.outcome

    def state(self, step: int) -> State:
        return self.states.state(step) if self.length else self.world.initial

    def seats(self, step: int) -> tuple[SeatView, ...]:
        seatings = self._seatings_by_step[bisect_right(self._seatings_from, step) - 1]
        return tuple(self._seat(player, seatings[player], step) for player in self.world.players)

    def _seat(self, player: str, seating: Seating, step: int) -> SeatView:
        present = seating.controller not in NOT_PRESENT
        stand_in = self._stand_in if seating.controller == Controller.STAND_IN else ""
        acted = self.count(player, Activity.ACTED, step)
        rejected = bisect_right(self._rejected[player], step)
        return SeatView(player, seating.name, seating.kind, present, acted, rejected, stand_in)

    def entries(self, step: int) -> tuple[Entry, ...]:
        found = self._kept.get(step)
        if found is None:
            if len(self._kept) >= MAX_KEPT:
                self._kept.clear()
            found = self._kept[step] = (*self._moves(step), *self._noted(step), *self._end(step))
        return found

    def _moves(self, step: int) -> Iterator[Entry]:
        """What was done in a step, and what its players thought."""
        if step == 0:
            return
        frame, (state, names) = self.states.frame(step), self._known_at(step - 1)
        unmet = frame.get("unmet", {})
        for place, move in enumerate(frame["moves"]):
            player, words = move["player"], unmet.get(str(place), ())
            if thought := move.get("reasoning"):
                yield Entry(step, EntryKind.REASONING, player, thought)
            kind = EntryKind.REJECTED if str(place) in unmet else EntryKind.ACTION
            reasons = self._spoken.reasons(words, (), state, names)
            does = self._spoken.move(move["action"], state, names)
            yield Entry(step, kind, player, does, reasons)

    def _noted(self, step: int) -> Iterator[Entry]:
        """What happened after a step, and what was refused."""
        for entry, note in self._notes.get(step, ()):
            if note is None:
                yield entry
                continue
            state, names = self._known_at(step)
            told = (note["reasons"], note.get("why", ()), state, names)
            does = self._spoken.attempt(note, state, names)
            yield replace(entry, words=does, reasons=self._spoken.reasons(*told))

    def _end(self, step: int) -> Iterator[Entry]:
        if self.outcome is not None and step == self.length:
            yield Entry(step, EntryKind.ENDED, "", outcome_words(self.outcome))

    def _known_at(self, step: int) -> tuple[State, dict[str, str]]:
        """The state at a step, the first one if it cannot be told, and what players are called."""
        try:
            state = self.state(step)
        except RobotouilleError:
            state = self.world.initial
        return state, {seat.player: seat.name for seat in self.seats(step) if seat.name}

    # The one pass

    def _read(self) -> None:
        frames = _Frames(self)
        try:
            for _, step in activities(frames):
                self._add_step(frames.time, step.did)
        except RobotouilleError as error:
            self.fault = self.fault or str(error)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            self.fault = self.fault or f"what it holds does not fit together: {error!r}"
        if not self.length:
            self._seatings_by_step = [self._seatings]
        if self.outcome is not None:
            self._mark(self._end(self.length))

    def add_frame(self, frame: dict[str, Any], position: int) -> None:
        """The next frame, which begins at a position of the stream."""
        match frame["kind"]:
            case "state":
                self.states.add_state(frame, position)
            case "notes":
                for note in frame["notes"]:
                    self._add_note({"step": self.length, **note})
            case "step":
                self._take(frame)
                self.states.add_step(frame, position)

    def _take(self, frame: dict[str, Any]) -> None:
        step, unmet = frame["step"], frame.get("unmet", {})
        if step != self.length + 1:
            raise RecordingError(f"step {self.length + 1} is missing")
        if self._seatings is not self._seatings_by_step[-1]:
            # Before the first step they are as in it.
            self._seatings_from.append(0 if step == 1 else step)
            self._seatings_by_step.append(self._seatings)
        for place, move in enumerate(frame["moves"]):
            lost = str(place) in unmet
            if lost and move["seq"]:
                self._rejected[move["player"]].append(step)
            if lost or "reasoning" in move:
                kind = EntryKind.REJECTED if lost else EntryKind.REASONING
                self._mark([Entry(step, kind, move["player"], "")])

    def _add_note(self, note: dict[str, Any]) -> None:
        kind, step = note["note"], note["step"]
        if kind == "said" and announced_version(note["text"]) is not None:
            return  # What bots only have for one another.
        if kind == "roster" and note["player"] in self._seatings:
            self._seatings = {**self._seatings, note["player"]: seating_after(note)}
        if kind == "rejected" and note["player"] in self._rejected:
            self._rejected[note["player"]].append(step)
        if kind in _TOLD:
            self._told.kept.append(note)
        if kind in ("said", "announced"):
            self._said.append((step, note.get("name", ""), note["text"]))
        entry = self._entry(note, _kind(note))
        self._notes[step].append((entry, note if kind == "rejected" else None))
        self._mark([entry])

    def _entry(self, note: Mapping[str, Any], kind: EntryKind) -> Entry:
        words, step, player = note_words(note, self._seated), note["step"], note.get("player", "")
        if kind in (EntryKind.REJECTED, EntryKind.SUPERSEDED):
            return Entry(step, kind, player, note["action"], tuple(note["reasons"]))
        if kind in (EntryKind.SAID, EntryKind.REASONING, EntryKind.ANNOUNCED):
            return Entry(step, kind, player, note["text"])
        return Entry(step, kind, player, words)


def _kind(note: Mapping[str, Any]) -> EntryKind:
    if note["note"] == "rejected" and rejection_kind(note) is RejectionKind.SUPERSEDED:
        return EntryKind.SUPERSEDED
    return _KINDS.get(note["note"], EntryKind.OTHER)


class _Frames:
    """A recording's frames, of each of which its history is told as they go by."""

    def __init__(self, history: RecordedHistory) -> None:
        self._history = history
        self._recording = history.recording
        self.time = 0

    @property
    def world(self) -> World:
        return self._recording.world

    def each_frame(self) -> Iterator[dict[str, Any]]:
        stream, position = self._recording.stream, len(MAGIC)
        for end in frame_ends(stream):
            if end > self._recording.whole:
                return
            frame = frame_value(stream, position, end)
            self.time = frame.get("t", 0)
            self._history.add_frame(frame, position)
            yield frame
            position = end

    def notes(self) -> Iterator[dict[str, Any]]:
        return self._recording.notes()

    def actions(self, frame: dict[str, Any]) -> list[GroundAction]:
        return self._recording.actions(frame)

    def take(self, state: State, frame: dict[str, Any]) -> Step:
        return self._recording.take(state, frame)
