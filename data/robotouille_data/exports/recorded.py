"""Episodes simulated from their recordings, and conversations for fine-tuning.

The catalogue's tables contain no states, so these formats read the recordings again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import sqlalchemy as sa

from robotouille.domain.task import Task
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.replay.conduct import rules_in
from robotouille.replay.recording import Recording, recording_of
from robotouille.replay.transitions import reward_of
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.sight import Sight
from robotouille.world.world import State, World
from robotouille_data.database import in_pieces
from robotouille_data.exports.observed import Observed
from robotouille_data.exports.request import ExportEntry, ExportRequest, Field, Part, WrittenFile
from robotouille_data.recording_rows import content_digest, read_content
from robotouille_data.schema import EPISODES, RECORDINGS


@dataclass(frozen=True, slots=True)
class AppliedMove:
    """Applied action. `own` is false for actions of a substitute."""

    action: GroundAction
    own: bool
    reasoning: str


@dataclass(frozen=True, slots=True)
class RecordedMoment:
    """Step with the states before and after it, and the applied action of each player."""

    step: int
    before: State
    after: State
    moves: Mapping[str, AppliedMove]

    @property
    def reward(self) -> float:
        """Reward of every seat; see `reward_of`."""
        return reward_of(self.before, self.after)

    @property
    def terminates(self) -> bool:
        """True if the step reached the goal, or ended the shift."""
        return self.after.goal_reached or self.after.shift_over


@dataclass(frozen=True, slots=True)
class SimulatedEpisode:
    """Episode with its steps.

    Attributes:
        reason: The reason for its end, or empty if not recorded.
        sight: Limits of the players' sight; None if they saw everything.
    """

    episode_id: int
    world: World
    reason: str
    moments: tuple[RecordedMoment, ...]
    sight: Sight | None = None

    def observed(self, state: State, player: str) -> Observed:
        """Return a state as a player saw it."""
        return Observed(state, player, self.sight)

    @property
    def task(self) -> Task:
        """Task of the episode."""
        return self.world.task


def replays(part: Part) -> Iterator[SimulatedEpisode]:
    """Yield the episodes of a part, grouped by task.

    An episode whose recording is missing, was changed or simulates differently becomes a fault.
    """
    world: World | None = None
    for ids in in_pieces(_by_task(part)):
        files = _files(part, ids)
        for number in ids:
            try:
                replay = _replayed(number, _recording(number, files.get(number, [])), world)
                world = replay.world
                yield replay
            # One unreadable recording must not lose the export of a study. The manifest lists it.
            except RobotouilleError as error:
                part.faults[number] = str(error)
            part.done(1)


def _by_task(part: Part) -> list[int]:
    digests: dict[int, str] = {}
    its = EPISODES.c
    for ids in in_pieces(part.ids):
        query = sa.select(its.id, its.digest).where(its.id.in_(ids))
        digests.update((number, digest) for number, digest in part.connection.execute(query))
    # Episodes of a task are together, so that they share a world. The ids make the order the same
    # on every machine.
    return sorted(digests, key=lambda number: (digests[number], number))


def _files(part: Part, ids: Sequence[int]) -> dict[int, list[tuple[str, str]]]:
    """Return the paths and digests of the episodes' recordings."""
    found: dict[int, list[tuple[str, str]]] = {}
    its = RECORDINGS.c
    query = sa.select(its.episode_id, its.path, its.digest).where(its.episode_id.in_(ids))
    for number, path, digest in part.connection.execute(query.order_by(its.path)):
        found.setdefault(number, []).append((path, digest))
    return found


def _recording(number: int, files: list[tuple[str, str]]) -> Recording:
    """Return the first copy of a recording that exists unchanged."""
    fault = "the recording is missing"
    for path, digest in files:
        try:
            content = read_content(Path(path))
        except FileNotFoundError:
            continue
        except OSError as error:
            fault = f"the recording cannot be read: {error.strerror}"
            continue
        except RecordingError as error:
            fault = f"the recording cannot be read: {error}"
            continue
        if content_digest(content) == digest:
            return recording_of(content, f"episode {number}")
        fault = "the recording was changed after it was indexed"
    raise RecordingError(fault)


def _replayed(number: int, recording: Recording, known: World | None) -> SimulatedEpisode:
    """Simulate an episode.

    `known` is the world of the previous episode. Reusing it for the same task keeps its caches.
    """
    digest = recording.task.digest
    if digest != recording.header["digest"]:
        raise RecordingError("this version reads the recorded task differently")
    if known is not None and known.task.digest == digest:
        recording.world = known
    moments, state = [], recording.world.initial
    for frame in recording.each_frame():
        if frame["kind"] == "step":
            moment = _moment(recording, state, frame)
            moments.append(moment)
            state = moment.after
    reason = "" if recording.outcome is None else str(recording.outcome["reason"])
    sight = rules_in(recording.header).limited_sight
    return SimulatedEpisode(number, recording.world, reason, tuple(moments), sight)


def _moment(recording: Recording, before: State, frame: dict[str, Any]) -> RecordedMoment:
    step, after = frame["step"], recording.take(before, frame).state
    # Only these formats can be wrong if the rules have changed since: the catalogue's tables come
    # from the recorded values.
    if frame.get("hash", after.digest) != after.digest:
        raise RecordingError(f"step {step} has a different result with this version's rules")
    unmet = frame.get("unmet", {})
    moves = {
        move["player"]: AppliedMove(action, move["seq"] > 0, move.get("reasoning", ""))
        for place, (move, action) in enumerate(
            zip(frame["moves"], recording.actions(frame), strict=True)
        )
        if str(place) not in unmet
    }
    return RecordedMoment(step, before, after, moves)


CHAT = ExportEntry(
    "chat",
    "one conversation per line: an object with `messages`, in the common format for fine-tuning",
    (
        Field(
            "messages",
            "list of {role, content}",
            "`system` (if a prompt was given), then alternating `user`: the observation in words, "
            "and `assistant`: the reasoning, if any, and the action. Actions of substitutes and "
            "rejected actions are left out.",
        ),
    ),
)
LINES = ExportEntry(
    "lines",
    "one row per line of `chat.jsonl`",
    (
        Field("line", "biginteger", "line number in `chat.jsonl`, from 0"),
        Field("episode_id", "biginteger", "`episodes.id` of the catalogue"),
        Field("seat", "integer", "`seats.seat` of the catalogue"),
        Field("step", "integer", "step of its first action"),
        Field("decisions", "integer", "number of actions", "actions"),
    ),
)


MAX_CHAT = 256 * 1024 * 1024
"""Limit on the characters of an episode's conversations. A recording of 70 KB can claim gigabytes
of observations in words."""


class _TooLongError(Exception):
    """The conversations of an episode exceed the limit."""


def write_chat(part: Part) -> Iterator[WrittenFile]:
    """Write `chat.jsonl`, and `lines.jsonl` with the episode and seat of each line."""
    part.codebook.update({entry.name: entry for entry in (CHAT, LINES)})
    chat, lines = part.folder / "chat.jsonl", part.folder / "lines.jsonl"
    count = decisions = 0
    with (
        chat.open("w", encoding="utf-8", newline="") as file,
        lines.open("w", encoding="utf-8", newline="") as table,
    ):
        names = [field.name for field in LINES.fields]
        for replay in replays(part):
            before, rows = file.tell(), list[tuple[int, ...]]()
            try:
                left = MAX_CHAT
                for seat, moments in _conversations(replay, part.request.per_decision):
                    player = replay.world.players[seat]
                    messages = _messages(replay, player, moments, part.request)
                    left -= _write_conversation(file, messages, left)
                    number = count + len(rows)
                    rows.append((number, replay.episode_id, seat, moments[0].step, len(moments)))
            except _TooLongError:
                file.seek(before)
                file.truncate()
                part.faults[replay.episode_id] = f"more than {MAX_CHAT >> 20} MiB of text"
                continue
            for row in rows:
                table.write(json.dumps(dict(zip(names, row, strict=True))) + "\n")
            count += len(rows)
            decisions += sum(row[-1] for row in rows)
    yield WrittenFile("chat", part.path(chat), count)
    yield WrittenFile("lines", part.path(lines), count, {"decisions": decisions})


def _conversations(
    replay: SimulatedEpisode, per_decision: bool
) -> Iterator[tuple[int, list[RecordedMoment]]]:
    """Yield seats with the steps in which their participants acted."""
    for seat, player in enumerate(replay.world.players):
        moments = [m for m in replay.moments if player in m.moves and m.moves[player].own]
        if per_decision:
            yield from ((seat, [moment]) for moment in moments)
        elif moments:
            yield seat, moments


def _write_conversation(file: TextIO, messages: Iterable[Mapping[str, str]], most: int) -> int:
    """Write a line, and return its number of characters.

    Raises:
        _TooLongError: The line has more than `most` characters.
    """
    # A message at a time, because a conversation can take most of the memory.
    written = file.write('{"messages": [')
    for number, message in enumerate(messages):
        written += file.write(", " * (number > 0) + json.dumps(message, ensure_ascii=False))
        if written > most:
            raise _TooLongError
    return written + file.write("]}\n")


def _messages(
    replay: SimulatedEpisode, player: str, moments: list[RecordedMoment], request: ExportRequest
) -> Iterator[dict[str, str]]:
    if request.system:
        yield {"role": "system", "content": request.system}
    for moment in moments:
        move = moment.moves[player]
        said = f"Action: {move.action.sentence}"
        if move.reasoning and request.texts:
            said = f"Reasoning: {move.reasoning}\n{said}"
        yield {"role": "user", "content": replay.observed(moment.before, player).text()}
        yield {"role": "assistant", "content": said}
