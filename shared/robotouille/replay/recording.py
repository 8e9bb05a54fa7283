"""Read a recording: its frames, its states with or without the engine, and whether it verifies."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from robotouille.domain.task import Task
from robotouille.errors import RecordingError, RobotouilleError, UnknownNameError
from robotouille.protocol.states import StateReader, StateWriter
from robotouille.replay.analysis.measures import Measures, measures
from robotouille.replay.analysis.transitions import Transition, transitions
from robotouille.replay.container import (
    MAGIC,
    MAX_FILE,
    frame_ends,
    frame_value,
    frames_with_ends,
    is_closed,
    magic,
    pack_frame,
    plain,
    version_of,
)
from robotouille.replay.frame_schema import check_frame
from robotouille.replay.notes import as_recorded
from robotouille.replay.recorder import keyframe, step_frames
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.objects import atom_name
from robotouille.world.world import State, Step, World

__all__ = ["Comparison", "Recording", "Verification", "read_recording", "recording_of"]


GIVEN = ("t", "moves", "idle", "waits", "undone")
"""The fields of a step that re-simulation cannot know."""


@dataclass(frozen=True, slots=True)
class Verification:
    """The result of re-simulating a recording.

    `fault` is empty where every fact, timer and hash came out alike and, `identical`, the frames
    written anew are the recorded ones byte for byte. `complete` says that the episode's end is
    recorded.
    """

    steps: int
    fault: str
    identical: bool
    complete: bool

    @property
    def ok(self) -> bool:
        """Whether it re-simulates, byte for byte."""
        return not self.fault and self.identical


class Recording:
    """One episode as its file has it.

    The first `whole` bytes of the stream hold its frames. They are decoded one by one, each time
    they are gone through: a recording may be large, and as Python's objects is many times that.

    Args:
        stream: The bytes of the file, not compressed.
        source: What errors call it.
        closed: It has to end with the footer.
        damaged: If it is damaged, what stands before the damage is read all the same, and
            `damage` says what it is.
        fault: The damage that is known already.

    Raises:
        RecordingError: It is damaged, or no recording, or of a format that is not known.
    """

    def __init__(
        self,
        stream: bytes,
        source: str = "recording",
        *,
        closed: bool = False,
        damaged: bool = False,
        fault: str = "",
    ) -> None:
        self._begin(stream, source)
        try:
            for _ in self._go_through(closed):
                pass
            if fault:
                raise RecordingError(fault)
        except RecordingError as error:
            if fault and not self.header:
                raise RecordingError(f"{source}: {fault}, before the first step") from None
            if not (damaged and self.header):
                raise
            self.damage = fault or str(error)

    @classmethod
    def opening(
        cls, stream: bytes, source: str, *, closed: bool
    ) -> Generator[int, None, Recording]:
        """The same frame by frame, for those who have something else to do in between.

        Yields:
            The number of steps so far.

        Returns:
            The recording, as the generator's value.

        Raises:
            RecordingError: It is damaged, or no recording, or of a format that is not known.
        """
        recording = cls.__new__(cls)
        recording._begin(stream, source)
        yield from recording._go_through(closed)
        return recording

    def _begin(self, stream: bytes, source: str) -> None:
        self.source = source
        self.stream = stream
        self.version = version_of(stream)
        self.header: dict[str, Any] = {}
        self.whole = 0
        self.length = 0
        self.outcome: dict[str, Any] | None = None
        self.damage = ""

    def _go_through(self, closed: bool) -> Generator[int, None, None]:
        """Check every frame, and that nothing is missing where nothing may be."""
        for number, (frame, end) in enumerate(frames_with_ends(self.stream)):
            if not number and frame.get("kind") != "header":
                break
            check_frame(frame, number)
            if self.outcome is not None:
                raise RecordingError(f"damaged at byte {self.whole}: a frame behind the footer")
            if frame["kind"] == "header" and not number:
                self.header = frame
            elif frame["kind"] == "step":
                self.length += 1
            elif frame["kind"] == "footer":
                self.outcome = frame["outcome"]
            self.whole = end
            yield self.length
        if not self.header:
            raise RecordingError(f"{self.source}: has no header")
        if closed and self.whole < len(self.stream):
            raise RecordingError(f"damaged at byte {self.whole}: a torn frame in a closed file")
        if closed and self.outcome is None:
            raise RecordingError(f"damaged at byte {self.whole}: the file is closed without an end")

    def each_frame(self) -> Iterator[dict[str, Any]]:
        """The frames in order, decoded anew."""
        position = len(MAGIC)
        for end in frame_ends(self.stream):
            if end > self.whole:
                return
            yield frame_value(self.stream, position, end)
            position = end

    @cached_property
    def frames(self) -> list[dict[str, Any]]:
        """All frames at once: for those of a long recording see `each_frame`."""
        return list(self.each_frame())

    @cached_property
    def steps(self) -> list[dict[str, Any]]:
        """The frames of all steps at once; `length` says how many there are."""
        return list(self._each_step())

    def _each_step(self) -> Iterator[dict[str, Any]]:
        return (frame for frame in self.each_frame() if frame["kind"] == "step")

    @cached_property
    def task(self) -> Task:
        """The task that was played.

        Raises:
            FileError: What is recorded of it is no task.
        """
        return Task.from_json(self.header["task"], self.source)

    @cached_property
    def world(self) -> World:
        """A world of the task, which is this recording's own."""
        return World(self.task)

    @cached_property
    def participants(self) -> dict[str, tuple[str, str]]:
        """Who played each seat last: name and kind. In seat order."""
        people: dict[str, tuple[str, str]] = {}
        for note in self.notes():
            if note["note"] == "roster" and note["name"]:
                people[note["player"]] = (note["name"], note["kind"])
        return {player: people[player] for player in self.world.players if player in people}

    def notes(self) -> Iterator[dict[str, Any]]:
        """Rejections, chat and roster changes, in order, each with the step it came after."""
        step = 0
        for frame in self.each_frame():
            if frame["kind"] == "step":
                step = frame["step"]
            elif frame["kind"] == "notes":
                for note in frame["notes"]:
                    yield {"step": step, **note}

    def actions(self, frame: dict[str, Any]) -> list[GroundAction]:
        """The joint action of a step's frame, in the order in which it applied.

        Raises:
            RecordingError: It has an action that the task has not, or one of another player's.
        """
        where = f"{self.source}: step {frame.get('step')}"
        try:
            actions = [self.world.action(*move["action"]) for move in frame["moves"]]
        except (KeyError, TypeError) as error:
            raise RecordingError(f"{where}: {error}") from None
        for move, action in zip(frame["moves"], actions, strict=True):
            mover = move["player"]
            if mover not in self.world.players or action.player not in (mover, None):
                raise RecordingError(f"{where}: {action} is no move of {mover!r}")
        return actions

    def take(self, state: State, frame: dict[str, Any]) -> Step:
        """Take a recorded step in a state: its actions, then what chance undid.

        Raises:
            RecordingError: It has an action or a fact that the task has not.
        """
        result = state.step(self.actions(frame))
        if not (undone := frame.get("undone")):
            return result
        try:
            after = result.state.without(tuple(atom) for atom in undone)
        except UnknownNameError as error:
            raise RecordingError(f"{self.source}: step {frame.get('step')}: {error}") from None
        return result._replace(state=after, goal_reached=after.goal_reached)

    def transitions(self) -> Iterator[Transition]:
        """All that the seats asked for, with the states before and after, by re-simulation.

        Raises:
            RecordingError: A step has an action that the task has not.
        """
        return transitions(self)

    def measures(self) -> Measures:
        """How the episode went, in numbers: for the team, and for each seat."""
        return measures(self)

    def states(self) -> Iterator[tuple[int, State]]:
        """The state at step 0 and after each step, by re-simulation.

        Raises:
            RecordingError: A step has an action that the task has not.
        """
        state = self.world.initial
        yield 0, state
        for frame in self._each_step():
            state = self.take(state, frame).state
            yield frame["step"], state

    def recorded_facts(self) -> Iterator[tuple[int, frozenset[str]]]:
        """The facts at each step as the file has them, without the engine.

        This needs neither this version's rules nor the domain: only the file's own tables.

        Raises:
            RecordingError: A frame speaks of what no table has.
        """
        try:
            yield from self._recorded_facts()
        except IndexError:
            fault = "a frame speaks of an object, predicate or fact that no table has"
            raise RecordingError(f"{self.source}: {fault}") from None

    def _recorded_facts(self) -> Iterator[tuple[int, frozenset[str]]]:
        tables = self.header["tables"]
        names = [row[0] for row in tables["objects"]]
        atoms = [_name(row, tables["predicates"], names) for row in tables["atoms"]]
        facts: set[int] = set()
        for frame in self.each_frame():
            if frame["kind"] == "state":
                facts = set(frame["facts"])
                if frame["step"] > 0:
                    continue
            elif frame["kind"] == "step":
                names += [row[0] for row in frame.get("objects", ())]
                rows = frame.get("atoms", ())
                atoms += [_name(row, tables["predicates"], names) for row in rows]
                facts = (facts | set(frame.get("add", ()))) - set(frame.get("remove", ()))
            else:
                continue
            yield frame["step"], frozenset(atoms[i] for i in facts if atoms[i])

    def verify(self) -> Verification:
        """Re-simulate, and compare every fact, timer and hash with the recorded ones, and the
        file with one that is written anew."""
        comparison = Comparison(self)
        try:
            fault = self._first_difference(comparison)
        except RobotouilleError as error:
            fault = str(error)
        identical = not fault and comparison.identical
        return Verification(self.length, fault, identical, self.outcome is not None)

    def _first_difference(self, comparison: Comparison) -> str:
        if self.task.digest != self.header["digest"]:
            return f"the task's hash is {self.task.digest}, recorded {self.header['digest']}"
        reader, expected, state = None, 0, self.world.initial
        for frame, state, written in self.anew():
            comparison.add(written)
            if frame["kind"] == "state" and reader is None:
                reader = StateReader(self.world, self.header["tables"], frame)
            elif frame["kind"] == "step":
                expected += 1
                if frame["step"] != expected or reader is None:
                    return f"step {expected} is missing: the next frame is step {frame['step']}"
                reader.apply(frame)
            recorded = reader.state if reader else state
            if difference := _difference(frame, state, recorded):
                return f"step {expected}: {difference}"
        return self._wrong_outcome(expected, state)

    def _wrong_outcome(self, steps: int, state: State) -> str:
        """What is wrong with the recorded outcome, if anything is."""
        outcome = self.outcome
        if outcome is None:
            return ""
        if outcome["steps"] != steps:
            return f"the outcome speaks of {outcome['steps']} steps, there are {steps}"
        if (outcome["reason"] == "goal") != state.goal_reached:
            reached = "is" if state.goal_reached else "is not"
            return f"the outcome is {outcome['reason']!r}, but the goal {reached} reached"
        return ""

    def resimulate(self) -> bytes:
        """The recording written anew from the header, the actions and the notes alone: `anew`."""
        return b"".join(written for _, _, written in self.anew())

    def anew(self) -> Iterator[tuple[dict[str, Any], State, bytes]]:
        """Each frame, the state after it by re-simulation, and what a recorder writes for it now:
        for a step also the keyframe that follows it, and for that nothing.

        Raises:
            RecordingError: A step has an action that the task has not.
        """
        writer, version = StateWriter(self.world), self.version
        state = self.world.initial
        for number, frame in enumerate(self.each_frame()):
            written = b""
            if not number:
                head = pack_frame({**frame, "tables": writer.tables(state)}, version)
                written = magic(version) + head + keyframe(writer, 0, state, version)
            elif frame["kind"] == "step":
                before, result = state, self.take(state, frame)
                state = result.state
                rows = {key: value for key, value in frame.items() if key in GIVEN}
                attempts, step = as_recorded(frame, result.attempts), frame["step"]
                written = step_frames(writer, step, rows, attempts, before, state, version)
            elif frame["kind"] in ("footer", "notes"):
                written = pack_frame(frame, version)
            yield frame, state, written


class Comparison:
    """Compares what is written anew with a recording, piece by piece. What goes beyond the
    recording's whole frames is `missing` in it: a keyframe that was not written any more."""

    def __init__(self, recording: Recording) -> None:
        self.same = True
        self.missing = b""
        self._recording = recording
        self._position = 0

    def add(self, written: bytes) -> None:
        """The next bytes of the recording written anew."""
        recording, position = self._recording, self._position
        known = min(len(written), max(0, recording.whole - position))
        self.same = self.same and recording.stream[position : position + known] == written[:known]
        self.missing += written[known:]
        self._position = position + len(written)

    @property
    def reaches_the_end(self) -> bool:
        """Whether nothing is recorded that was not written anew."""
        return self._position >= self._recording.whole

    @property
    def identical(self) -> bool:
        """Whether the whole frames of the file are these; where it is over, all of it."""
        recording = self._recording
        if recording.outcome is not None:
            return self.same and self._position == recording.whole == len(recording.stream)
        return self.same and self.reaches_the_end


def _name(row: list[int], predicates: list[str], names: list[str]) -> str:
    """An atom's name; empty for the bookkeeping of created objects."""
    if row[0] < 0:
        return ""
    return atom_name((predicates[row[0]], *(names[i] for i in row[1:])))


def _difference(frame: dict[str, Any], state: State, recorded: State) -> str:
    if state != recorded:
        ours, theirs = set(state.fact_names()), set(recorded.fact_names())
        for name in sorted(ours ^ theirs):
            now, then = ("true", "false") if name in ours else ("false", "true")
            return f"{name} is {now} now, was {then} when recorded"
        return f"timers are {state.timer_rows()} now, were {recorded.timer_rows()} when recorded"
    if "hash" in frame and frame["hash"] != state.digest:
        return f"the state's hash is {state.digest}, recorded {frame['hash']}"
    return ""


def read_recording(path: Path | str, *, damaged: bool = False) -> Recording:
    """The recording in a file, open or closed; an open one may be torn at its end.

    Args:
        damaged: What stands before the damage is read, if there is any: see `Recording.damage`.

    Raises:
        RecordingError: The file cannot be read, is damaged otherwise, or is no recording.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_FILE:
            raise RecordingError(f"{path}: larger than {MAX_FILE:,} bytes")
        with path.open("rb") as file:  # A device has no size, and no end.
            content = file.read(MAX_FILE + 1)
        if len(content) > MAX_FILE:
            raise RecordingError(f"{path}: larger than {MAX_FILE:,} bytes")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        return recording_of(content, str(path), damaged=damaged)
    except RecordingError as error:
        message = str(error)
        prefix = "" if message.startswith(str(path)) else f"{path}: "
        raise RecordingError(f"{prefix}{message}") from None


def recording_of(content: bytes, source: str, *, damaged: bool = False) -> Recording:
    """The recording in a file's content, like `read_recording`.

    Args:
        source: What errors call it.

    Raises:
        RecordingError: It is damaged, or no recording.
    """
    stream, fault = plain(content)
    if fault and not damaged:
        raise RecordingError(fault)
    closed = is_closed(content)
    return Recording(stream, source, closed=closed, damaged=damaged, fault=fault)
