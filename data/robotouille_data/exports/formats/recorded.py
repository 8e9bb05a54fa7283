"""Episodes played again from their recordings: what the tables do not hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from robotouille.domain.task import Task
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.replay.recording import Recording, recording_of
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_data.database import in_pieces
from robotouille_data.exports.part import Part
from robotouille_data.recordings.reading import content_digest, read_content
from robotouille_data.schema import EPISODES, RECORDINGS

__all__ = ["Moment", "Move", "Replay", "replays"]


@dataclass(frozen=True, slots=True)
class Move:
    """An action that was applied; `own` ones are the participant's, all others a stand-in's."""

    action: GroundAction
    own: bool
    reasoning: str


@dataclass(frozen=True, slots=True)
class Moment:
    """A step: the states before and after it, and by player what was applied in it."""

    step: int
    before: State
    after: State
    moves: Mapping[str, Move]

    @property
    def reward(self) -> float:
        """1 for the step that reaches the goal, else 0, for each seat."""
        return float(self.after.goal_reached and not self.before.goal_reached)


@dataclass(frozen=True, slots=True)
class Replay:
    """An episode: its steps, and why it ended (empty: that is not recorded)."""

    episode_id: int
    world: World
    reason: str
    moments: tuple[Moment, ...]

    @property
    def task(self) -> Task:
        """What was played."""
        return self.world.task


def replays(part: Part) -> Iterator[Replay]:
    """The episodes of a part, those of a task one after the other. Of one whose recording is gone,
    was changed or does not come out alike today, the reason is noted as a fault instead."""
    world: World | None = None
    for ids in in_pieces(_by_task(part)):
        files = _files(part, ids)
        for number in ids:
            try:
                replay = _replayed(number, _recording(number, files.get(number, [])), world)
                world = replay.world
                yield replay
            except RobotouilleError as error:
                part.faults[number] = str(error)
            part.done(1)


def _by_task(part: Part) -> list[int]:
    digests: dict[int, str] = {}
    its = EPISODES.c
    for ids in in_pieces(part.ids):
        query = sa.select(its.id, its.digest).where(its.id.in_(ids))
        digests.update((number, digest) for number, digest in part.connection.execute(query))
    return sorted(digests, key=lambda number: (digests[number], number))


def _files(part: Part, ids: Sequence[int]) -> dict[int, list[tuple[str, str]]]:
    """The paths and digests of the recordings of some episodes."""
    found: dict[int, list[tuple[str, str]]] = {}
    its = RECORDINGS.c
    query = sa.select(its.episode_id, its.path, its.digest).where(its.episode_id.in_(ids))
    for number, path, digest in part.connection.execute(query.order_by(its.path)):
        found.setdefault(number, []).append((path, digest))
    return found


def _recording(number: int, files: list[tuple[str, str]]) -> Recording:
    """The first of some copies that is there and as it was."""
    fault = "its recording is gone"
    for path, digest in files:
        try:
            content = read_content(Path(path))
        except FileNotFoundError:
            continue
        except OSError as error:
            fault = f"its recording cannot be read: {error.strerror}"
            continue
        except RecordingError as error:
            fault = f"its recording cannot be read: {error}"
            continue
        if content_digest(content) == digest:
            return recording_of(content, f"episode {number}")
        fault = "its recording was changed since it was indexed"
    raise RecordingError(fault)


def _replayed(number: int, recording: Recording, known: World | None) -> Replay:
    """An episode; `known` is the world of the one before, which knows what play comes to."""
    digest = recording.task.digest
    if digest != recording.header["digest"]:
        raise RecordingError("its task is read as another one by this version")
    if known is not None and known.task.digest == digest:
        recording.world = known
    moments, state = [], recording.world.initial
    for frame in recording.each_frame():
        if frame["kind"] == "step":
            moment = _moment(recording, state, frame)
            moments.append(moment)
            state = moment.after
    reason = "" if recording.outcome is None else str(recording.outcome["reason"])
    return Replay(number, recording.world, reason, tuple(moments))


def _moment(recording: Recording, before: State, frame: dict[str, Any]) -> Moment:
    step, after = frame["step"], recording.take(before, frame).state
    if frame.get("hash", after.digest) != after.digest:
        raise RecordingError(f"step {step} comes out otherwise by this version's rules")
    unmet = frame.get("unmet", {})
    moves = {
        move["player"]: Move(action, move["seq"] > 0, move.get("reasoning", ""))
        for place, (move, action) in enumerate(
            zip(frame["moves"], recording.actions(frame), strict=True)
        )
        if str(place) not in unmet
    }
    return Moment(step, before, after, moves)
