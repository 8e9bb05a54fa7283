"""Recordings: their frames, states, verification and re-simulation."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import Any

from robotouille.domain.task import Task
from robotouille.errors import RecordingError, RobotouilleError, UnknownNameError, WrongWorldError
from robotouille.files.reading import open_regular
from robotouille.protocol.states import GrowingTable, StateReader, StateWriter
from robotouille.replay.compression import is_closed, plain
from robotouille.replay.conduct import Conduct, wrong_outcome
from robotouille.replay.container import (
    MAGIC,
    MAX_FILE,
    Totals,
    check_magic,
    frame_ends,
    frame_value,
    frames_with_ends,
    pack_frame,
    step_number,
)
from robotouille.replay.frame_schema import STATE_FIELDS, check_frame
from robotouille.replay.measures import Measures, measures
from robotouille.replay.recorder import keyframe, step_frames
from robotouille.replay.transitions import Transition, transitions
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.objects import atom_name
from robotouille.world.world import State, Step, World

# All other fields of a step follow from the state before it. Chance decides `undone`.
GIVEN = ("t", "late", "moves", "idle", "waits", "undone")
"""Fields of a step that re-simulation cannot know."""


@dataclass(frozen=True, slots=True)
class Verification:
    """Result of re-simulating a recording.

    Attributes:
        steps: Number of steps.
        fault: The first difference in a fact, timer, hash or outcome, or the first broken rule of
            play; otherwise empty.
        identical: True if the re-simulated frames equal the recorded ones byte for byte.
        complete: True if the recording contains the episode's end.
    """

    steps: int
    fault: str
    identical: bool
    complete: bool

    @property
    def ok(self) -> bool:
        """True if the recording re-simulates byte for byte."""
        return not self.fault and self.identical


class Recording:
    """The recording of one episode.

    Frames are decoded each time they are read. As Python objects, the frames of a long recording
    would take many times the memory of its bytes.

    Args:
        stream: The uncompressed bytes of the file.
        source: Name of the recording in errors.
        closed: True if the recording must end with a footer.
        damaged: True to read a damaged recording up to the damage.
        fault: Damage that decompression has found.

    Attributes:
        header: The first frame.
        length: Number of steps.
        count: Number of frames.
        whole: Length of the stream up to the last whole frame.
        outcome: The outcome; None if the episode's end is not recorded.
        damage: Description of the damage, if `damaged` permits it.

    Raises:
        RecordingError: The stream is damaged, or is not a recording of a known format.
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
        """Read a recording frame by frame, so that the caller can do other work in between.

        Yields:
            The number of steps so far.

        Returns:
            The recording, as the value of the generator.

        Raises:
            RecordingError: The stream is damaged, or is not a recording of a known format.
        """
        recording = cls.__new__(cls)
        recording._begin(stream, source)
        yield from recording._go_through(closed)
        return recording

    def extending(self, stream: bytes) -> Generator[int, None, Recording]:
        """Read the recording of a stream that has more frames, as `opening` does.

        The frames that both streams begin with are not decoded again.

        Raises:
            RecordingError: The stream is damaged.
        """
        if not stream.startswith(self.stream[: self.whole]):
            return (yield from self.opening(stream, self.source, closed=False))
        longer = copy(self)
        for outdated in ("frames", "steps", "participants"):
            longer.__dict__.pop(outdated, None)
        longer.stream, longer.totals = stream, copy(self.totals)
        yield from longer._go_through(closed=False)
        return longer

    def _begin(self, stream: bytes, source: str) -> None:
        self.source = source
        self.stream = stream
        check_magic(stream)
        self.header: dict[str, Any] = {}
        self.whole = len(MAGIC)
        self.totals = Totals()
        self.length = self.count = 0
        self.outcome: dict[str, Any] | None = None
        self.damage = ""

    def _go_through(self, closed: bool) -> Generator[int, None, None]:
        """Check every frame, and that a closed recording is complete."""
        frames = frames_with_ends(self.stream, self.whole, self.totals)
        for number, (frame, end) in enumerate(frames, self.count):
            if not number and frame.get("kind") != "header":
                break
            check_frame(frame, number)
            if self.outcome is not None:
                raise RecordingError(f"damaged at byte {self.whole}: a frame follows the footer")
            if frame["kind"] == "header" and not number:
                self.header = frame
            elif frame["kind"] == "step":
                self.length += 1
            elif frame["kind"] == "footer":
                self.outcome = frame["outcome"]
            self.whole, self.count = end, number + 1
            yield self.length
        if not self.header:
            raise RecordingError(f"{self.source}: the header is missing")
        if closed and self.whole < len(self.stream):
            raise RecordingError(f"damaged at byte {self.whole}: a torn frame in a closed file")
        if closed and self.outcome is None:
            raise RecordingError(f"damaged at byte {self.whole}: a closed file without a footer")

    def each_frame(self, *, states: bool = True) -> Iterator[dict[str, Any]]:
        """Yield the frames in order.

        Args:
            states: False if the caller ignores the fields in `STATE_FIELDS`, which may be missing.
        """
        without = () if states else STATE_FIELDS
        return (frame for frame, _ in self.frames_from(len(MAGIC), without))

    def frames_from(
        self, position: int, without: Collection[str] = ()
    ) -> Iterator[tuple[dict[str, Any], int]]:
        """Yield the frames from a position on, each with the position of its end."""
        for end in self._each_end(position):
            yield frame_value(self.stream, position, end, checked=True, without=without), end
            position = end

    def _each_end(self, position: int = len(MAGIC)) -> Iterator[int]:
        return takewhile(lambda end: end <= self.whole, frame_ends(self.stream, position))

    @cached_property
    def frames(self) -> list[dict[str, Any]]:
        """All frames. Prefer `each_frame` for long recordings."""
        return list(self.each_frame())

    @cached_property
    def steps(self) -> list[dict[str, Any]]:
        """The frames of all steps."""
        return list(self.each_step())

    def each_step(self) -> Iterator[dict[str, Any]]:
        """Yield the frames of all steps. Prefer this to `steps` for long recordings."""
        return (frame for frame in self.each_frame() if frame["kind"] == "step")

    @cached_property
    def task(self) -> Task:
        """The task that was played.

        Raises:
            FileError: The recorded task is invalid.
        """
        return Task.from_json(self.header["task"], self.source)

    @cached_property
    def world(self) -> World:
        """A world of the task, used by this recording only."""
        return World(self.task)

    @cached_property
    def participants(self) -> dict[str, tuple[str, str]]:
        """Name and kind of each seat's last participant, in seat order."""
        people = dict.fromkeys(self.world.players, ("", ""))
        for note in self.notes():
            if note["note"] == "roster" and note["name"] and note["player"] in people:
                people[note["player"]] = (note["name"], note["kind"])
        return {player: person for player, person in people.items() if person[0]}

    def notes(self) -> Iterator[dict[str, Any]]:
        """Yield the notes in order, each with the number of the step before it as `step`."""
        step, position = 0, len(MAGIC)
        for end in self._each_end():
            # Most frames are steps, and decoding takes ten times as long as finding their number.
            number = step_number(self.stream, position)
            if number is None:
                frame = frame_value(self.stream, position, end, checked=True, without=STATE_FIELDS)
                step = frame["step"] if frame["kind"] == "step" else step
                for note in frame.get("notes", ()):
                    yield {"step": step, **note}
            else:
                step = number
            position = end

    def actions(self, frame: dict[str, Any]) -> list[GroundAction]:
        """Return the joint action of a step's frame, in the order in which it applied.

        Raises:
            RecordingError: The task has no such action, or the action moves another player.
        """
        where = f"{self.source}: step {frame.get('step')}"
        try:
            for move in frame["moves"]:
                # Callers that do not simulate the steps have created none of the step's objects.
                self.world.admit(move["action"][1:])
            actions = [self.world.action(*move["action"]) for move in frame["moves"]]
        except (KeyError, TypeError, WrongWorldError) as error:
            raise RecordingError(f"{where}: {error}") from None
        for move, action in zip(frame["moves"], actions, strict=True):
            mover = move["player"]
            if mover not in self.world.players or action.player not in (mover, None):
                raise RecordingError(f"{where}: {action} is not an action of {mover!r}")
        return actions

    def take(self, state: State, frame: dict[str, Any]) -> Step:
        """Take a recorded step in a state: its actions, then its random reversals.

        Raises:
            RecordingError: The task has no such action or fact.
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
        """Yield all requests of the seats with the states before and after; see `transitions`."""
        return transitions(self)

    def measures(self) -> Measures:
        """Return the measures of the team and of each seat."""
        return measures(self)

    def states(self) -> Iterator[tuple[int, State]]:
        """Yield the initial state (step 0) and the state after each step, by re-simulation.

        Raises:
            RecordingError: The task has no such action.
        """
        state = self.world.initial
        yield 0, state
        for frame in self.each_step():
            state = self.take(state, frame).state
            yield frame["step"], state

    def recorded_facts(self) -> Iterator[tuple[int, frozenset[str]]]:
        """Yield the recorded facts at each step, without re-simulation.

        Only the file's own tables are used, so this works even if the engine has changed.

        Raises:
            RecordingError: A frame refers to an entry that the tables do not have.
        """
        try:
            yield from self._recorded_facts()
        except IndexError:
            fault = "a frame refers to an object, predicate or fact that the tables do not have"
            raise RecordingError(f"{self.source}: {fault}") from None

    def _recorded_facts(self) -> Iterator[tuple[int, frozenset[str]]]:
        # The names come from the file, because a later version may number the world's atoms
        # differently.
        tables = self.header["tables"]
        predicates = tables["predicates"]
        objects = GrowingTable[str](row[0] for row in tables["objects"])
        atoms = GrowingTable[tuple[int, ...]](map(tuple, tables["atoms"]))
        names = [_name(atom, predicates, objects.rows) for atom in atoms.rows]
        facts: set[int] = set()
        for frame in self.each_frame():
            if frame["kind"] == "state":
                facts = set(frame["facts"])
                if frame["step"] > 0:
                    continue
            elif frame["kind"] == "step":
                objects.extend(row[0] for row in frame.get("objects", ()))
                created = atoms.extend(map(tuple, frame.get("atoms", ())))
                names += [_name(atom, predicates, objects.rows) for atom in created]
                facts = (facts | set(frame.get("add", ()))) - set(frame.get("remove", ()))
            else:
                continue
            yield frame["step"], frozenset(names[i] for i in facts if names[i])

    def verify(self) -> Verification:
        """Re-simulate, compare all facts, timers, hashes and bytes, and check the rules of play."""
        comparison = Comparison(self)
        try:
            fault = self._first_difference(comparison)
        except RobotouilleError as error:
            fault = str(error)
        identical = not fault and comparison.identical
        return Verification(self.length, fault, identical, self.outcome is not None)

    def _first_difference(self, comparison: Comparison) -> str:
        if self.task.digest != self.header["digest"]:
            return f"the task's hash is {self.task.digest}, but {self.header['digest']} is recorded"
        reader, expected, state = None, 0, self.world.initial
        conduct = Conduct(self.header, self.world.players)
        for frame, after, written in self.resimulated_frames():
            comparison.add(written)
            if frame["kind"] == "state" and reader is None:
                reader = StateReader(self.world, self.header["tables"], frame)
            elif frame["kind"] == "step":
                expected += 1
                if frame["step"] != expected or reader is None:
                    return f"step {expected} is missing: the next frame is step {frame['step']}"
                reader.apply(frame)
            recorded = reader.state if reader else after
            if difference := _difference(frame, after, recorded):
                return f"step {expected}: {difference}"
            if frame["kind"] == "step" and (fault := conduct.fault(frame, state)):
                return f"step {expected}: {fault}"
            if frame["kind"] == "notes" and (fault := conduct.wrong_note(frame)):
                return f"after step {expected}: {fault}"
            state = after
        if self.outcome is None:
            return ""
        return self._wrong_end(self.outcome, expected, state) or wrong_outcome(
            self, self.outcome, conduct.latest
        )

    def _wrong_end(self, outcome: dict[str, Any], steps: int, state: State) -> str:
        if outcome["steps"] != steps:
            return f"the outcome has {outcome['steps']} steps, but the recording has {steps}"
        if (outcome["reason"] == "goal") != state.goal_reached:
            reached = "is" if state.goal_reached else "is not"
            return f"the outcome is {outcome['reason']!r}, but the goal {reached} reached"
        if (outcome["reason"] == "shift_over") != state.shift_over:
            over = "is" if state.shift_over else "is not"
            return f"the outcome is {outcome['reason']!r}, but the shift {over} over"
        orders = state.orders
        if orders is not None and outcome.get("score") != {
            "points": orders.score,
            "served": orders.served,
            "expired": orders.expired,
        }:
            return f"the outcome has the score {outcome.get('score')}, but the orders {orders.row}"
        return ""

    def resimulate(self) -> bytes:
        """Return the bytes of the recording, written again from its header, actions and notes."""
        return b"".join(written for _, _, written in self.resimulated_frames())

    def resimulated_frames(
        self, frames: Iterable[dict[str, Any]] | None = None
    ) -> Iterator[tuple[dict[str, Any], State, bytes]]:
        """Yield each frame, the state after it by re-simulation, and its bytes as written again.

        The bytes of a step include the keyframe after it, so those of a keyframe are empty.

        Args:
            frames: The frames, if the caller has decoded them already.

        Raises:
            RecordingError: The task has no such action.
        """
        writer, state = StateWriter(self.world), self.world.initial
        for number, frame in enumerate(self.each_frame() if frames is None else frames):
            written = b""
            if not number:
                head = pack_frame({**frame, "tables": writer.tables(state)})
                written = MAGIC + head + keyframe(writer, 0, state)
            elif frame["kind"] == "step":
                before, result = state, self.take(state, frame)
                state = result.state
                rows = {key: value for key, value in frame.items() if key in GIVEN}
                attempts = result.attempts
                written = step_frames(writer, frame["step"], rows, attempts, (before, state))
            elif frame["kind"] in ("footer", "notes"):
                written = pack_frame(frame)
            yield frame, state, written


class Comparison:
    """Comparison of a recording with its re-simulated bytes, piece by piece.

    Attributes:
        same: True while all bytes are equal.
        missing: Re-simulated bytes after the recording's last whole frame: a keyframe that the
            process could not write before it stopped.
    """

    def __init__(self, recording: Recording) -> None:
        self.same = True
        self.missing = b""
        self._recording = recording
        self._position = 0

    def continue_with(self, longer: Recording) -> bool:
        """Go on with a recording that has more frames; return False if it begins differently.

        Call this while nothing is `missing`.
        """
        begin, self._recording = self._recording.stream[: self._position], longer
        return longer.stream.startswith(begin)

    def add(self, written: bytes) -> None:
        """Compare the next re-simulated bytes."""
        recording, position = self._recording, self._position
        known = min(len(written), max(0, recording.whole - position))
        self.same = self.same and recording.stream[position : position + known] == written[:known]
        # A step and the keyframe after it are two frames. If the process stops between them, the
        # file has no torn end, but the keyframe is missing.
        self.missing += written[known:]
        self._position = position + len(written)

    @property
    def reaches_the_end(self) -> bool:
        """True if every recorded byte has been compared."""
        return self._position >= self._recording.whole

    @property
    def identical(self) -> bool:
        """True if all whole frames are equal, and for a complete recording all bytes."""
        recording = self._recording
        if recording.outcome is not None:
            return self.same and self._position == recording.whole == len(recording.stream)
        return self.same and self.reaches_the_end


def _name(row: tuple[int, ...], predicates: list[str], names: list[str]) -> str:
    if row[0] < 0:  # Bookkeeping of created objects.
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
        return f"the state's hash is {state.digest}, but {frame['hash']} is recorded"
    return ""


def read_recording(path: Path | str, *, damaged: bool = False) -> Recording:
    """Read the recording in a file, open or closed. An open one may be torn at its end.

    Args:
        damaged: True to read a damaged recording up to the damage; see `Recording.damage`.

    Raises:
        RecordingError: The file cannot be read, is damaged, or is not a recording.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_FILE:
            raise RecordingError(f"{path}: larger than {MAX_FILE:,} bytes")
        with open_regular(path) as file:
            # The server may append to the file after its size was checked.
            content = file.read(MAX_FILE + 1)
        if len(content) > MAX_FILE:
            raise RecordingError(f"{path}: larger than {MAX_FILE:,} bytes")
    except IsADirectoryError:
        raise RecordingError(f"{path}: is a folder; expected a recording (.rbt)") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        return recording_of(content, str(path), damaged=damaged)
    except RecordingError as error:
        message = str(error)
        prefix = "" if message.startswith(str(path)) else f"{path}: "
        raise RecordingError(f"{prefix}{message}") from None


def recording_of(content: bytes, source: str, *, damaged: bool = False) -> Recording:
    """Read a recording from a file's content; see `read_recording`.

    Args:
        source: Name of the recording in errors.

    Raises:
        RecordingError: The content is damaged, or is not a recording.
    """
    stream, fault = plain(content)
    if fault and not damaged:
        raise RecordingError(fault)
    closed = is_closed(content)
    return Recording(stream, source, closed=closed, damaged=damaged, fault=fault)
