"""Conversion of an episode's events to the frames of a recording.

The bytes depend only on the header and the events, so a re-simulation can be compared with the
original recording byte for byte.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from robotouille.domain.task import Task
from robotouille.episode.events import (
    ActionRejected,
    EpisodeEnded,
    Event,
    PlayedMove,
    Stepped,
)
from robotouille.episode.rules import Rules, SeatTreatment
from robotouille.installation import VERSION
from robotouille.protocol.states import StateWriter, unmet_rows
from robotouille.replay.container import MAGIC, Totals, pack_frame
from robotouille.replay.frame_schema import milliseconds, note_of
from robotouille.world.unmet import Attempt
from robotouille.world.world import State, World

HASH_EVERY = 10
"""Steps between hashes. A hash takes longer to compute than the rest of a step's frame."""
SNAPSHOT_EVERY = 100
"""Steps between whole states, from which a viewer can start in the middle."""
MAX_NOTES = 50
"""Notes in a frame. The longest note (a rejection with 8,000 characters of reasoning and its
reasons) takes less than 80 KiB, so 50 of them fit into the largest frame."""


@dataclass(frozen=True, slots=True)
class HeaderDetails:
    """Fields of a header that only episodes of a server or a study have.

    Attributes:
        code: The code with which participants join.
        owner: Pseudonym of the episode's creator.
        labels: The study's labels.
        treatments: The study's treatment of seats, by player.
        open_until: Time at which the episode closes if nobody comes, in milliseconds since 1970.
        rematch_by: Session and pseudonym of the player who requested the episode as a rematch.
    """

    code: str = ""
    owner: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    treatments: Mapping[str, SeatTreatment] = field(default_factory=dict)
    open_until: int | None = None
    rematch_by: Sequence[str] = ()


def header(
    task: Task,
    rules: Rules,
    *,
    episode: str,
    seed: int = 0,
    created: str = "",
    details: HeaderDetails | None = None,
) -> dict[str, Any]:
    """Return the first frame of a recording, without its tables.

    Args:
        episode: The episode's id.
        seed: The seed used to load the task.
        created: The time of creation in UTC (ISO 8601).
    """
    details = details or HeaderDetails()
    treated = {
        player: treatment.model_dump(exclude_defaults=True)
        for player, treatment in details.treatments.items()
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
        "code": details.code,
        "owner": details.owner,
        **({"labels": dict(details.labels)} if details.labels else {}),
        **({"treatments": treated} if treated else {}),
        **({"open_until": details.open_until} if details.open_until is not None else {}),
        **({"rematch_by": list(details.rematch_by)} if details.rematch_by else {}),
    }


@dataclass(slots=True)
class Recorder:
    """Turns the events of one episode into the bytes to append to its file.

    Attributes:
        wall: Returns the seconds since 1970 (UTC). None records no times of day, so that recordings
            are reproducible.
        clock: Returns the seconds on a clock that is never set, as the caller of the episode reads
            them. None records none.
        totals: Counts over the frames in the file so far.
    """

    world: World
    wall: Callable[[], float] | None = None
    clock: Callable[[], float] | None = None
    totals: Totals = field(default_factory=Totals)
    writer: StateWriter = field(init=False)

    def __post_init__(self) -> None:
        self.writer = StateWriter(self.world)

    def begin(self, head: dict[str, Any]) -> bytes:
        """Return the first bytes of a file: magic, header with tables, and initial state.

        Args:
            head: The value of `header`.

        Raises:
            RecordingError: A frame would exceed the limits of readers.
        """
        initial = self.world.initial
        self.totals.frames = 2
        # The tables keep a recording readable when this version no longer simulates it
        # (docs/decisions/0008).
        head = {**head, "tables": self.writer.tables(initial)}
        return MAGIC + pack_frame(head) + keyframe(self.writer, 0, initial)

    def record(self, events: Iterable[Event]) -> bytes:
        """Return the frames of some events, in order.

        Raises:
            RecordingError: A frame would exceed the limits of readers.
        """
        frames = []
        notes: list[dict[str, Any]] = []
        for event in events:
            if isinstance(event, Stepped):
                frame = self._step(event)
            elif isinstance(event, EpisodeEnded):
                outcome = event.outcome.to_json()
                frame = pack_frame({"kind": "footer", "outcome": outcome, **self._times()})
                self.totals.frames += 1
            # Beyond the seat's quota. Steps count no activity for it either, see
            # `Seat.count_rejection`.
            elif isinstance(event, ActionRejected) and not event.recorded:
                continue
            else:
                notes.append(note_of(event, self._times()))
                continue
            if notes:
                frames += self._notes(notes)
                notes = []
            frames.append(frame)
        frames += self._notes(notes)
        return b"".join(frames)

    def _times(self) -> dict[str, int]:
        """Return the time of day and of the clock, as recorded."""
        clocks = (("utc_ms", self.wall), ("clock_ms", self.clock))
        return {name: milliseconds(read()) for name, read in clocks if read is not None}

    def _step(self, event: Stepped) -> bytes:
        rows: dict[str, Any] = {"t": milliseconds(event.time)}
        if late := milliseconds(event.late):
            rows["late"] = late
        rows["moves"] = [_move(move) for move in event.moves]
        if event.idle:
            rows["idle"] = event.idle
        if event.waits:
            rows["waits"] = event.waits
        if event.undone:
            rows["undone"] = event.undone
        states = (event.before, event.state)
        # The writer keeps the changes for `step_frames`. A keyframe is a part of its step's bytes.
        # There are few of them.
        self.totals.add(self.writer.changes(*states))
        return step_frames(self.writer, event.step, rows, event.attempts, states)

    def _notes(self, notes: list[dict[str, Any]]) -> list[bytes]:
        pieces = [notes[at : at + MAX_NOTES] for at in range(0, len(notes), MAX_NOTES)]
        frames = [{"kind": "notes", "notes": piece} for piece in pieces]
        for frame in frames:
            self.totals.add(frame)
        return [pack_frame(frame) for frame in frames]


def _move(move: PlayedMove) -> dict[str, Any]:
    # Unlike notes, steps have hand-written code, because they are recorded up to sixty times a
    # second.
    row: dict[str, Any] = {
        "player": move.player,
        "action": [move.action.name, *move.action.arguments],
        "seq": move.seq,
        "ms": milliseconds(move.latency),
    }
    if move.basis is not None:
        row["basis"] = move.basis
    if move.reasoning:
        row["reasoning"] = move.reasoning
    return row


def step_frames(
    writer: StateWriter,
    step: int,
    rows: dict[str, Any],
    attempts: tuple[Attempt, ...],
    states: tuple[State, State],
) -> bytes:
    """Return the frame of a step, and the keyframe after it if one is due.

    Args:
        rows: The fields that re-simulation cannot know: see `GIVEN` in `recording.py`.
        states: The states before and after the step.
    """
    frame = {"kind": "step", "step": step, **rows}
    if unmet := unmet_rows(attempts):
        frame["unmet"] = unmet
    # These come after the given fields, because the order of the keys is part of the bytes that
    # verification compares.
    frame |= writer.changes(*states)
    if step % HASH_EVERY == 0:
        frame["hash"] = writer.digest(states[1])
    output = pack_frame(frame)
    if step % SNAPSHOT_EVERY == 0:
        output += keyframe(writer, step, states[1])
    return output


def keyframe(writer: StateWriter, step: int, state: State) -> bytes:
    """Return the frame of a whole state."""
    values = writer.values(state)
    return pack_frame({"kind": "state", "step": step, "hash": writer.digest(state), **values})
