"""History of a recording, built in one pass through its frames."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.episode import TEAM_TOPIC, Controller, RejectionKind
from robotouille.episode.tallies import Activity
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.replay.container import MAGIC, frame_ends, frame_value
from robotouille.replay.controllers import Seating, seating_after
from robotouille.replay.looks import choose_look
from robotouille.replay.measures import activities, rejection_kind
from robotouille.replay.rates import recorded_rate
from robotouille.replay.recording import Recording, read_recording
from robotouille.replay.timeline import interludes, note_words
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, Step, World
from robotouille_client.window.replay.histories.history import (
    Entry,
    EntryKind,
    History,
    HistoryWording,
)
from robotouille_client.window.replay.histories.recorded_states import RecordedStates
from robotouille_client.window.sources.texts import outcome_words
from robotouille_client.window.view import SeatView


def open_shown(path: Path, tasks: Path | None = None, *, damaged: bool = False) -> Recording:
    """Read a recording and choose its look.

    The rendering comes from `tasks`, else from the recording's folder, else from the current
    folder. A kitchen without a rendering there looks as if it had no folder.

    Raises:
        RobotouilleError: The recording cannot be read.
    """
    recording = read_recording(path, damaged=damaged)
    folders = [path.parent, Path.cwd()]
    choose_look(recording, folders if tasks is None else [tasks, *folders])
    return recording


NOT_PRESENT = (Controller.FREE, Controller.ABSENT, Controller.SUBSTITUTE)
_KINDS = {
    "rejected": EntryKind.REJECTED,
    "said": EntryKind.SAID,
    "noted": EntryKind.REASONING,
    "roster": EntryKind.SEAT,
    "paused": EntryKind.PAUSED,
    "restarted": EntryKind.RESTARTED,
    "announced": EntryKind.ANNOUNCED,
}
# Steps whose events are cached as words, and their events.
MAX_KEPT, MAX_KEPT_ENTRIES = 256, 2_000
# Events after a step that the log shows. A recording can have 300,000.
MAX_NOTED = 1_000
# Characters of a chat line and of an event in the log; longer ones are cut.
MAX_LINE, MAX_WORDS = 500, 10_000
# Notes from which interludes are made, and how many of them are kept.
MAX_INTERLUDES = 10_000
_INTERLUDES = frozenset({"paused", "resumed", "restarted", "announced"})


@dataclass(slots=True)
class _InterludeNotes:
    outcome: dict[str, Any] | None
    kept: list[dict[str, Any]] = field(default_factory=list)

    def notes(self) -> Iterator[dict[str, Any]]:
        return iter(self.kept)


class _SeatingChanges:
    """Course of one seat. `next` is its participant and controller from the next step on."""

    __slots__ = ("_from", "_seatings", "next")

    def __init__(self) -> None:
        self.next = Seating()
        self._from = array("q", [0])
        self._seatings = [self.next]

    def begin(self, step: int) -> None:
        if self.next is not self._seatings[-1]:
            self._from.append(step)
            self._seatings.append(self.next)

    def at(self, step: int) -> Seating:
        return self._seatings[bisect_right(self._from, step) - 1]


class RecordedHistory(History):
    """History of a recording.

    Where the frames stop making sense, the history ends, and `fault` says why. The log uses the
    domain's words, with `words` laid over them.
    """

    def __init__(self, recording: Recording, words: Language = NO_WORDS) -> None:
        super().__init__(recording.world)
        self.recording = recording
        self.max_steps = recording.header["rules"]["max_steps"]
        self.rate = recorded_rate(recording.header["rules"])
        self.states = RecordedStates(recording.world, recording.stream, recording.header["tables"])
        self._substitute = str(recording.header["rules"].get("substitute", "bot"))
        self._seatings = {player: _SeatingChanges() for player in self.world.players}
        self._seated: dict[str, tuple[str, str]] = {}
        self._rejected = {player: array("q") for player in self.world.players}
        # Words of notes could take most of the memory, so only their places are kept: the position
        # of the frame and the number in it. Words of roster notes depend on earlier notes.
        self._notes: dict[int, list[Entry | tuple[int, int]]] = defaultdict(list)
        self._wording = HistoryWording(self.world, language_of(self.world.task).with_words(words))
        self._kept: dict[int, tuple[Entry, ...]] = {}
        self._kept_entries = 0
        self._interlude_notes = _InterludeNotes(recording.outcome)
        self.fault = recording.damage
        self._read()
        self.interludes = interludes(self._interlude_notes)

    @property
    def outcome(self) -> Mapping[str, object] | None:
        return self.recording.outcome

    def state(self, step: int) -> State:
        return self.states.state(step) if self.length else self.world.initial

    def seats(self, step: int) -> tuple[SeatView, ...]:
        return tuple(
            self._seat(player, changes.at(step), step) for player, changes in self._seatings.items()
        )

    def _seat(self, player: str, seating: Seating, step: int) -> SeatView:
        present = seating.controller not in NOT_PRESENT
        substitute = self._substitute if seating.controller == Controller.SUBSTITUTE else ""
        acted = self.count(player, Activity.ACTED, step)
        rejected = bisect_right(self._rejected[player], step)
        return SeatView(player, seating.name, seating.kind, present, acted, rejected, substitute)

    def entries(self, step: int) -> tuple[Entry, ...]:
        found = self._kept.get(step)
        if found is None:
            # Words are made on demand: most steps of a recording are never looked at closely.
            found = (*self._moves(step), *self._noted(step), *self._end(step))
            self._kept_entries += len(found)
            if len(self._kept) >= MAX_KEPT or self._kept_entries > MAX_KEPT_ENTRIES:
                self._kept.clear()
                self._kept_entries = len(found)
            self._kept[step] = found
        return found

    def _moves(self, step: int) -> Iterator[Entry]:
        """Yield the actions of a step and the reasoning behind them."""
        if step == 0:
            return
        frame, (state, names) = self.states.frame(step), self._known_at(step - 1)
        unmet = frame.get("unmet", {})
        for place, move in enumerate(frame["moves"]):
            player, words = move["player"], unmet.get(str(place), ())
            if thought := move.get("reasoning"):
                yield Entry(step, EntryKind.REASONING, player, thought)
            kind = EntryKind.REJECTED if str(place) in unmet else EntryKind.ACTION
            reasons = self._wording.reasons(words, (), state, names)
            does = self._wording.move(move["action"], state, names)
            yield Entry(step, kind, player, does, reasons)

    def _noted(self, step: int) -> Iterator[Entry]:
        """Yield the events after a step, such as rejected requests."""
        frame, read = {}, -1
        for noted in self._notes.get(step, ()):
            if isinstance(noted, Entry):
                yield noted
                continue
            position, number = noted
            if position != read:
                frame, read = frame_value(self.recording.stream, position), position
            note = {"step": step, **frame["notes"][number]}
            entry = self._entry(note, _kind(note))
            if note["note"] == "rejected":
                state, names = self._known_at(step)
                reasons = (note["reasons"], note.get("why", ()), state, names)
                does = self._wording.attempt(note, state, names)
                entry = replace(entry, words=does, reasons=self._wording.reasons(*reasons))
            yield entry

    def _end(self, step: int) -> Iterator[Entry]:
        if self.outcome is not None and step == self.length:
            yield Entry(step, EntryKind.ENDED, "", outcome_words(self.outcome))

    def _known_at(self, step: int) -> tuple[State, dict[str, str]]:
        """Return the state at a step, or else the initial one, and the players' names."""
        try:
            state = self.state(step)
        except RobotouilleError:
            state = self.world.initial
        return state, {seat.player: seat.name for seat in self.seats(step) if seat.name}

    # The pass through the frames

    def _read(self) -> None:
        frames = _Frames(self)
        try:
            for _, step in activities(frames):
                self._add_step(frames.time, step.did)
        except RobotouilleError as error:
            self.fault = self.fault or str(error)
        # Frames are valid MessagePack but may hold anything. The part read so far can still be
        # watched.
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            self.fault = self.fault or f"its content is inconsistent: {error!r}"
        if not self.length:
            self._seat_all(0)
        if self.outcome is not None:
            self._mark(self._end(self.length))

    def add_frame(self, frame: dict[str, Any], position: int) -> None:
        """Add the next frame, which starts at a position of the stream."""
        match frame["kind"]:
            case "state":
                self.states.add_state(frame, position)
            case "notes":
                for number, note in enumerate(frame["notes"]):
                    self._add_note({"step": self.length, **note}, (position, number))
            case "step":
                self._take(frame)
                self.states.add_step(frame, position)

    def _take(self, frame: dict[str, Any]) -> None:
        step, unmet = frame["step"], frame.get("unmet", {})
        if step != self.length + 1:
            raise RecordingError(f"step {self.length + 1} is missing")
        # Before the first step, the seats are as in that step.
        self._seat_all(0 if step == 1 else step)
        for place, move in enumerate(frame["moves"]):
            lost = str(place) in unmet
            if lost and move["seq"]:
                self._rejected[move["player"]].append(step)
            if lost or "reasoning" in move:
                kind = EntryKind.REJECTED if lost else EntryKind.REASONING
                self._mark([Entry(step, kind, move["player"], "")])

    def _seat_all(self, step: int) -> None:
        for changes in self._seatings.values():
            changes.begin(step)

    def _add_note(self, note: dict[str, Any], place: tuple[int, int]) -> None:
        kind, step = note["note"], note["step"]
        if kind == "noted" and note["topic"] == TEAM_TOPIC:
            return  # Bots announce their version to each other; people need not see that.
        if kind == "roster" and note["player"] in self._seatings:
            self._seatings[note["player"]].next = seating_after(note)
        if kind == "rejected" and note["player"] in self._rejected:
            self._rejected[note["player"]].append(step)
        if kind in _INTERLUDES and len(self._interlude_notes.kept) < MAX_INTERLUDES:
            self._interlude_notes.kept.append({**note, "text": note.get("text", "")[:MAX_LINE]})
        if kind in ("said", "announced"):
            self._said.append((step, note.get("name", ""), note["text"][:MAX_LINE]))
        # The words of a roster note tell what has changed since the last one.
        entry = self._entry(note, _kind(note)) if kind == "roster" else None
        if len(self._notes[step]) < MAX_NOTED:
            self._notes[step].append(entry or place)
        self._mark([entry or Entry(step, _kind(note), note.get("player", ""), "")])

    def _entry(self, note: Mapping[str, Any], kind: EntryKind) -> Entry:
        words, step, player = note_words(note, self._seated), note["step"], note.get("player", "")
        if kind in (EntryKind.REJECTED, EntryKind.SUPERSEDED):
            return Entry(step, kind, player, note["action"], tuple(note["reasons"]))
        if kind in (EntryKind.SAID, EntryKind.REASONING, EntryKind.ANNOUNCED):
            words = note["text"][:MAX_WORDS]
            return Entry(step, kind, player, words, target=note.get("target") or "")
        return Entry(step, kind, player, words)


def _kind(note: Mapping[str, Any]) -> EntryKind:
    if note["note"] == "rejected" and rejection_kind(note) is RejectionKind.SUPERSEDED:
        return EntryKind.SUPERSEDED
    return _KINDS.get(note["note"], EntryKind.OTHER)


class _Frames:
    """Frames of a recording, handed to its history one by one."""

    def __init__(self, history: RecordedHistory) -> None:
        self._history = history
        self._recording = history.recording
        self.time = 0

    @property
    def world(self) -> World:
        return self._recording.world

    def each_frame(self, *, states: bool = True) -> Iterator[dict[str, Any]]:
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
