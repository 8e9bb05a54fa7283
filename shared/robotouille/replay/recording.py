"""Read a recording: its frames, its states with or without the engine, and whether it verifies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from robotouille.domain.task import Task
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.protocol.states import StateReader, StateWriter
from robotouille.replay.frames import MAGIC, MAX_FILE, frames_with_ends, pack_frame, unwrap
from robotouille.replay.recorder import keyframe, step_frames
from robotouille.replay.schema import check_frame
from robotouille.world.actions import GroundAction
from robotouille.world.objects import atom_name
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["Recording", "Verification", "read_recording"]


GIVEN = ("t", "moves", "idle")
"""The fields of a step that re-simulation cannot know."""


@dataclass(frozen=True, slots=True)
class Verification:
    """The result of re-simulating a recording.

    `fault` is empty where every fact, timer and hash came out alike and, `identical`, the frames
    written anew are the recorded ones byte for byte.
    """

    steps: int
    fault: str
    identical: bool
    complete: bool

    @property
    def ok(self) -> bool:
        return not self.fault and self.identical


class Recording:
    """The frames of one episode; the first `whole` bytes of the stream hold them."""

    def __init__(self, stream: bytes, source: str = "recording") -> None:
        self.source = source
        self.stream = stream
        found = list(frames_with_ends(stream))
        frames = [frame for frame, _ in found]
        self.whole = found[-1][1] if found else 0
        if not frames or frames[0].get("kind") != "header":
            raise RecordingError(f"{source}: has no header")
        for number, frame in enumerate(frames):
            check_frame(frame, number)
        self.header: dict[str, Any] = frames[0]
        self.frames = frames
        self.steps = [frame for frame in frames if frame.get("kind") == "step"]

    @property
    def outcome(self) -> dict[str, Any] | None:
        """How it ended; None where the file was cut off before the end."""
        footer = next((frame for frame in self.frames if frame["kind"] == "footer"), None)
        outcome: dict[str, Any] | None = footer["outcome"] if footer is not None else None
        return outcome

    @cached_property
    def task(self) -> Task:
        """The task that was played."""
        return Task.from_json(self.header["task"], self.source)

    @cached_property
    def world(self) -> World:
        return World(self.task)

    @cached_property
    def participants(self) -> dict[str, tuple[str, str]]:
        """Who played each seat last: name and kind."""
        people: dict[str, tuple[str, str]] = {}
        for note in self.notes():
            if note["note"] == "roster" and note["name"]:
                people[note["player"]] = (note["name"], note["kind"])
        return people

    def notes(self) -> Iterator[dict[str, Any]]:
        """Rejections, chat and roster changes, in order, each with the step it came after."""
        step = 0
        for frame in self.frames:
            if frame["kind"] == "step":
                step = frame["step"]
            elif frame["kind"] == "notes":
                for note in frame["notes"]:
                    yield {"step": step, **note}

    def actions(self, frame: dict[str, Any]) -> list[GroundAction]:
        """The joint action of a step, in the order in which it applied."""
        try:
            return [self.world.action(*move["action"]) for move in frame["moves"]]
        except (KeyError, TypeError) as error:
            step = frame.get("step")
            raise RecordingError(f"{self.source}: step {step}: {error}") from None

    def states(self) -> Iterator[tuple[int, State]]:
        """The state at step 0 and after each step, by re-simulation."""
        state = self.world.initial
        yield 0, state
        for frame in self.steps:
            state = state.step(self.actions(frame)).state
            yield frame["step"], state

    def recorded_facts(self) -> Iterator[tuple[int, frozenset[str]]]:
        """The facts at each step as the file has them, without the engine.

        This needs neither this version's rules nor the domain: only the file's own tables.
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
        for frame in self.frames:
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
        """Re-simulate, and compare every fact, timer and hash with the recorded ones."""
        complete = self.outcome is not None
        try:
            fault = self._first_difference()
        except RobotouilleError as error:
            fault = str(error)
        identical = not fault and self._same_bytes(self.resimulate())
        return Verification(len(self.steps), fault, identical, complete)

    def _same_bytes(self, anew: bytes) -> bool:
        """Whether the whole frames of the file are these; one that was cut off does not count,
        nor does a keyframe that was not yet written."""
        whole = self.whole
        if self.outcome is not None:
            return anew == self.stream
        return anew[:whole] == self.stream[:whole]

    def _first_difference(self) -> str:
        if self.task.digest != self.header["digest"]:
            return f"the task's hash is {self.task.digest}, recorded {self.header['digest']}"
        state, reader, expected = self.world.initial, None, 0
        for frame in self.frames[1:]:
            if frame["kind"] == "state" and reader is None:
                reader = StateReader(self.world, self.header["tables"], frame)
            elif frame["kind"] == "step":
                expected += 1
                if frame["step"] != expected or reader is None:
                    return f"step {expected} is missing: the next frame is step {frame['step']}"
                state = state.step(self.actions(frame)).state
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
        """The recording written anew from the header, the actions and the notes alone."""
        writer = StateWriter(self.world)
        tables = writer.tables(self.world.initial)
        state = self.world.initial
        head = pack_frame({**self.header, "tables": tables})
        output = [MAGIC, head, keyframe(writer, 0, state)]
        for frame in self.frames:
            if frame["kind"] == "step":
                before, result = state, state.step(self.actions(frame))
                state = result.state
                rows = {key: value for key, value in frame.items() if key in GIVEN}
                attempts = result.attempts
                output.append(step_frames(writer, frame["step"], rows, attempts, before, state))
            elif frame["kind"] in ("footer", "notes"):
                output.append(pack_frame(frame))
        return b"".join(output)


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


def read_recording(path: Path | str) -> Recording:
    """The recording in a file, open or closed, whole or cut off; RecordingError otherwise."""
    path = Path(path)
    try:
        if path.stat().st_size > MAX_FILE:
            raise RecordingError(f"{path}: larger than {MAX_FILE:,} bytes")
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        return Recording(unwrap(content), str(path))
    except RecordingError as error:
        message = str(error)
        prefix = "" if message.startswith(str(path)) else f"{path}: "
        raise RecordingError(f"{prefix}{message}") from None
