"""Episode events to the frames of a recording.

The bytes depend on the header and the events alone, so that a re-simulation can be compared with
the original byte for byte.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from robotouille.domain.task import Task
from robotouille.episode.events import (
    Ended,
    Event,
    Move,
    Rejected,
    RosterChanged,
    Said,
    Started,
    Stepped,
)
from robotouille.episode.rules import Rules
from robotouille.protocol.states import StateWriter
from robotouille.replay.frames import MAGIC, pack_frame
from robotouille.world.state import State
from robotouille.world.world import Attempt, World

__all__ = ["HASH_EVERY", "SNAPSHOT_EVERY", "Recorder", "header", "keyframe", "step_frames"]

HASH_EVERY = 10
SNAPSHOT_EVERY = 100


def header(
    task: Task, rules: Rules, *, episode: str, seed: int = 0, created: str = ""
) -> dict[str, Any]:
    """The first frame: everything that play starts from. `created` is an ISO 8601 time."""
    return {
        "kind": "header",
        "software": version("robotouille"),
        "episode": episode,
        "created": created,
        "task": task.to_json(),
        "digest": task.digest,
        "seed": seed,
        "rules": rules.model_dump(mode="json"),
    }


@dataclass(slots=True)
class Recorder:
    """Turns the events of one episode into the bytes to append to its file."""

    world: World
    head: dict[str, Any]
    reasoning: dict[str, str] = field(default_factory=dict)
    writer: StateWriter = field(init=False)
    _notes: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.writer = StateWriter(self.world)

    def begin(self) -> bytes:
        """The magic, the header with its tables, and the initial state."""
        initial = self.world.initial
        head = {**self.head, "tables": self.writer.tables(initial)}
        return MAGIC + pack_frame(head) + keyframe(self.writer, 0, initial)

    def record(self, events: Iterable[Event]) -> bytes:
        """The frames of some events; rejections, chat and roster changes wait for the next step."""
        output = b""
        for event in events:
            match event:
                case Stepped():
                    output += self._step(event)
                case Ended():
                    output += self._footer(event)
                case _:
                    self._notes.append(_note(event))
        return output

    def _step(self, event: Stepped) -> bytes:
        rows = {"t": _ms(event.time), "moves": [self._move(move) for move in event.moves]}
        rows |= self._take_notes()
        return step_frames(self.writer, event.step, rows, event.attempts, event.before, event.state)

    def _move(self, move: Move) -> dict[str, Any]:
        row: dict[str, Any] = {
            "player": move.player,
            "action": [move.action.name, *move.action.arguments],
            "seq": move.seq,
            "ms": _ms(move.latency),
        }
        thought = self.reasoning.pop(move.player, None)
        return row | ({"reasoning": thought} if thought else {})

    def _footer(self, event: Ended) -> bytes:
        frame = {"kind": "footer", "outcome": event.outcome.to_json(), **self._take_notes()}
        return pack_frame(frame)

    def _take_notes(self) -> dict[str, Any]:
        notes, self._notes = self._notes, []
        return {"notes": notes} if notes else {}


def step_frames(
    writer: StateWriter,
    step: int,
    rows: dict[str, Any],
    attempts: tuple[Attempt, ...],
    before: State,
    after: State,
) -> bytes:
    """The frame of a step, and the keyframe after it where one is due.

    `rows` holds what re-simulation cannot know: `t`, `moves` and `notes`.
    """
    frame = {"kind": "step", "step": step, **rows}
    unmet = {str(i): list(a.unmet) for i, a in enumerate(attempts) if not a.applied}
    if unmet:
        frame["unmet"] = unmet
    frame |= writer.changes(before, after)
    if step % HASH_EVERY == 0:
        frame["hash"] = after.digest
    output = pack_frame(frame)
    if step % SNAPSHOT_EVERY == 0:
        output += keyframe(writer, step, after)
    return output


def keyframe(writer: StateWriter, step: int, state: State) -> bytes:
    """The frame of a whole state."""
    return pack_frame({"kind": "state", "step": step, "hash": state.digest, **writer.values(state)})


def _ms(seconds: float) -> int:
    return round(seconds * 1000)


def _note(event: Event) -> dict[str, Any]:
    match event:
        case Rejected():
            return {
                "note": "rejected",
                "t": _ms(event.time),
                "player": event.player,
                "seq": event.seq,
                "action": event.action,
                "reasons": list(event.reasons),
            }
        case Said():
            return {
                "note": "said",
                "t": _ms(event.time),
                "name": event.name,
                "player": event.player,
                "text": event.text,
            }
        case RosterChanged():
            return {
                "note": "roster",
                "t": _ms(event.time),
                "player": event.player,
                "name": event.name,
                "kind": event.kind,
                "present": event.present,
            }
        case Started():
            return {"note": "started", "t": 0}
    raise AssertionError(f"not a note: {event}")
