"""Episode events to the frames of a recording.

The bytes depend on the header and the events alone, so that a re-simulation can be compared with
the original byte for byte.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from robotouille.domain.task import Task
from robotouille.episode.events import (
    ACTION_INVALID,
    Announced,
    CountdownChanged,
    Ended,
    Event,
    Moderated,
    Move,
    Noted,
    Paused,
    QuotaReached,
    ReadinessChanged,
    Rejected,
    Restarted,
    Resumed,
    RosterChanged,
    RoundTripMeasured,
    Said,
    Started,
    Stepped,
)
from robotouille.episode.rules import Rules, SeatTreatment
from robotouille.protocol.states import StateWriter, unmet_rows, why_row
from robotouille.release import VERSION
from robotouille.replay.container import FORMAT_VERSION, magic, pack_frame
from robotouille.world.unmet import Attempt, UnmetKind
from robotouille.world.world import State, World

__all__ = [
    "HASH_EVERY",
    "SNAPSHOT_EVERY",
    "Recorder",
    "header",
    "iso_time",
    "keyframe",
    "step_frames",
]

BASIC_TIME = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)Z")

HASH_EVERY = 10
SNAPSHOT_EVERY = 100
MAX_NOTES = 50
"""Notes in a frame: the longest (a rejection with 8,000 characters of reasoning and its reasons)
takes less than 80 KiB, so that they all fit."""


def iso_time(created: str) -> str:
    """The `created` of a recording, which is in the basic form of ISO 8601, in its extended form,
    as `2026-11-22T19:13:39Z`, which sorts and compares with dates; anything else as it is."""
    return (
        BASIC_TIME.sub(r"\1-\2-\3T\4:\5:\6Z", created) if BASIC_TIME.fullmatch(created) else created
    )


def header(
    task: Task,
    rules: Rules,
    *,
    episode: str,
    seed: int = 0,
    created: str = "",
    code: str = "",
    owner: str = "",
    labels: Mapping[str, str] | None = None,
    treatments: Mapping[str, SeatTreatment] | None = None,
    open_until: int | None = None,
) -> dict[str, Any]:
    """The first frame: everything that play starts from.

    Args:
        episode: The episode's id.
        seed: That with which the task was loaded.
        created: An ISO 8601 time.
        code: What one joins with.
        owner: The pseudonym of who opened the episode.
        labels: What the episode belongs to, in words of a study.
        treatments: What the study does to seats, by player.
        open_until: When it is closed if nobody has come, in milliseconds since 1970 (UTC).
    """
    treated = {
        player: treatment.model_dump(exclude_defaults=True)
        for player, treatment in (treatments or {}).items()
    }
    return {
        "kind": "header",
        "software": VERSION,
        "episode": episode,
        "created": created,
        "task": task.json,
        "digest": task.digest,
        "seed": seed,
        "rules": rules.model_dump(mode="json"),
        "code": code,
        "owner": owner,
        **({"labels": dict(labels)} if labels else {}),
        **({"treatments": treated} if treated else {}),
        **({"open_until": open_until} if open_until is not None else {}),
    }


WALL_TIMED = (CountdownChanged, Started, Resumed, Restarted)
"""Events of which it is written when they were."""


@dataclass(slots=True)
class Recorder:
    """Turns the events of one episode into the bytes to append to its file, which has one format
    version from its beginning to its end.

    `wall` gives the seconds since 1970, UTC: where time began to run, and where it did so again,
    is written when that was. Without it nothing is.
    """

    world: World
    version: int = FORMAT_VERSION
    wall: Callable[[], float] | None = None
    writer: StateWriter = field(init=False)

    def __post_init__(self) -> None:
        self.writer = StateWriter(self.world)

    def begin(self, head: dict[str, Any]) -> bytes:
        """The magic, the header with its tables, and the initial state.

        Args:
            head: What `header` gives.

        Raises:
            RecordingError: A frame would be larger than can be read.
        """
        initial = self.world.initial
        head = {**head, "tables": self.writer.tables(initial)}
        first = keyframe(self.writer, 0, initial, self.version)
        return magic(self.version) + pack_frame(head, self.version) + first

    def record(self, events: Iterable[Event]) -> bytes:
        """The frames of some events, in order; nothing is held back.

        Raises:
            RecordingError: A frame would be larger than can be read.
        """
        frames = []
        notes: list[dict[str, Any]] = []
        for event in events:
            if isinstance(event, Stepped):
                frame = self._step(event)
            elif isinstance(event, Ended):
                frame = _footer(event, self.version)
            elif isinstance(event, Rejected) and not event.recorded:
                continue
            else:
                notes.append(self._note(event))
                continue
            if notes:
                frames.append(_notes_frames(notes, self.version))
                notes = []
            frames.append(frame)
        if notes:
            frames.append(_notes_frames(notes, self.version))
        return b"".join(frames)

    def _note(self, event: Event) -> dict[str, Any]:
        note = _note(event)
        if self.wall is not None and isinstance(event, WALL_TIMED):
            note["utc_ms"] = _ms(self.wall())
        return note

    def _step(self, event: Stepped) -> bytes:
        rows: dict[str, Any] = {"t": _ms(event.time), "moves": [_move(m) for m in event.moves]}
        if event.idle:
            rows["idle"] = [[player, seq] for player, seq in event.idle]
        if event.waits:
            rows["waits"] = list(event.waits)
        if event.undone:
            rows["undone"] = [list(atom) for atom in event.undone]
        before, after = event.before, event.state
        return step_frames(
            self.writer, event.step, rows, event.attempts, before, after, self.version
        )


def _move(move: Move) -> dict[str, Any]:
    row: dict[str, Any] = {
        "player": move.player,
        "action": [move.action.name, *move.action.arguments],
        "seq": move.seq,
        "ms": _ms(move.latency),
    }
    if move.basis is not None:
        row["basis"] = move.basis
    return row | ({"reasoning": move.reasoning} if move.reasoning else {})


def _footer(event: Ended, version: int) -> bytes:
    return pack_frame({"kind": "footer", "outcome": event.outcome.to_json()}, version)


def _notes_frames(notes: list[dict[str, Any]], version: int) -> bytes:
    """Rejections, chat and roster changes between two steps, in as few frames as are read."""
    if len(notes) <= MAX_NOTES:
        return pack_frame({"kind": "notes", "notes": notes}, version)
    pieces = (notes[at : at + MAX_NOTES] for at in range(0, len(notes), MAX_NOTES))
    return b"".join(_notes_frames(piece, version) for piece in pieces)


def step_frames(
    writer: StateWriter,
    step: int,
    rows: dict[str, Any],
    attempts: tuple[Attempt, ...],
    before: State,
    after: State,
    version: int = FORMAT_VERSION,
) -> bytes:
    """The frame of a step, and the keyframe after it where one is due.

    `rows` holds what re-simulation cannot know: `t`, `moves`, `idle`, `waits` and `undone`.
    """
    frame = {"kind": "step", "step": step, **rows}
    if unmet := unmet_rows(attempts):
        frame["unmet"] = unmet
    frame |= writer.changes(before, after)
    if step % HASH_EVERY == 0:
        frame["hash"] = writer.digest(after)
    output = pack_frame(frame, version)
    if step % SNAPSHOT_EVERY == 0:
        output += keyframe(writer, step, after, version)
    return output


def keyframe(writer: StateWriter, step: int, state: State, version: int = FORMAT_VERSION) -> bytes:
    """The frame of a whole state."""
    values = writer.values(state)
    return pack_frame(
        {"kind": "state", "step": step, "hash": writer.digest(state), **values}, version
    )


def _ms(seconds: float) -> int:
    return round(seconds * 1000)


def _row(note: str, seconds: float, **told: Any) -> dict[str, Any]:
    return {"note": note, "t": _ms(seconds), **told}


def _rejection(event: Rejected) -> dict[str, Any]:
    note = _row(
        "rejected",
        event.time,
        player=event.player,
        seq=event.seq,
        action=event.action,
        reasons=list(event.reasons),
    )
    if any(unmet.kind is not UnmetKind.OTHER for unmet in event.unmet):
        note["why"] = [why_row(unmet) for unmet in event.unmet]
    if event.code != ACTION_INVALID:
        note["code"] = event.code
    if event.text:
        note["text"] = event.text
    if event.basis is not None:
        note["basis"] = event.basis
    if event.reasoning:
        note["reasoning"] = event.reasoning
    if not event.heard:
        note["heard"] = False
    return note


def _roster(event: RosterChanged) -> dict[str, Any]:
    note = _row(
        "roster",
        event.time,
        player=event.player,
        name=event.name,
        kind=event.kind,
        present=event.present,
        taken=event.taken,
        controller=event.controller.value,
        session=event.session,
        participant=event.participant,
        generation=event.generation,
    )
    if event.why:
        note["why"] = event.why.value
    return note


def _noted(event: Noted) -> dict[str, Any]:
    more = {"more": True} if event.more else {}
    return _row(
        "noted", event.time, player=event.player, topic=event.topic, text=event.text, **more
    )


def _moderation(event: Moderated) -> dict[str, Any]:
    return _row(
        "moderated",
        event.time,
        what=event.what.value,
        session=event.session,
        participant=event.participant,
        name=event.name,
    )


def _note(event: Event) -> dict[str, Any]:
    match event:
        case Rejected():
            return _rejection(event)
        case Said():
            return _row("said", event.time, name=event.name, player=event.player, text=event.text)
        case Noted():
            return _noted(event)
        case RosterChanged():
            return _roster(event)
        case ReadinessChanged():
            return _row("ready", 0, player=event.player, ready=event.ready)
        case QuotaReached():
            return _row("quota", event.time, player=event.player)
        case RoundTripMeasured():
            ms = round(event.seconds * 1000, 1)
            return _row("round_trip", event.time, player=event.player, ms=ms)
        case Announced():
            return _row("announced", event.time, text=event.text)
        case Moderated():
            return _moderation(event)
        case Paused():
            return _row("paused", event.time, holds=[reason.value for reason in event.reasons])
        case CountdownChanged():
            until = {} if event.seconds is None else {"ms": _ms(event.seconds)}
            return _row("countdown", 0, **until)
        case Started():
            return _row("started", 0)
        case Resumed():
            return _row("resumed", event.time)
        case Restarted():
            return _row("restarted", event.time)
    raise AssertionError(f"not a note: {event}")
