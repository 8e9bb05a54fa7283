"""Recovery of episodes from their recordings after a process has stopped."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from robotouille.domain.task import Task
from robotouille.episode import (
    ActionAnswer,
    Episode,
    EpisodeRecord,
    Moderation,
    Outcome,
    PauseReason,
    Phase,
    PlayedMove,
    Rules,
    Seat,
    SeatTreatment,
)
from robotouille.episode.events import ACTION_INVALID
from robotouille.episode.quota import NOTE_BYTES, Quota, size_of_note, size_of_rejection
from robotouille.errors import RecordingError
from robotouille.replay.conduct import rules_in
from robotouille.replay.container import MAGIC
from robotouille.replay.measures import controller_of, rejection_kind
from robotouille.replay.recording import Comparison, Recording
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World


@dataclass(frozen=True, slots=True)
class Restored:
    """An episode that goes on where its recording ends.

    Attributes:
        kept: Number of bytes of the file that are valid. The rest is torn.
        missing: Bytes to append to them before anything else.
        said: The chat messages so far.
        complete: True if the episode had ended and the file only has to be closed.
    """

    episode: Episode
    kept: int
    missing: bytes
    said: tuple[dict[str, Any], ...]
    complete: bool


def restore(
    recording: Recording,
    now: float,
    patience: float,
    world_of: Callable[[Task], World] = World,
) -> Restored:
    """Return the episode of a recording that was cut off anywhere after its header.

    Args:
        patience: Seconds for which the game waits for the participants who were present.
        world_of: Makes the world of a task.

    Raises:
        RecordingError: The recording does not re-simulate.
    """
    steps = restoring(recording, now, patience, world_of)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: Restored = end.value
            return found
        except _DifferentError:
            fault = recording.verify().fault or "its frames differ from those of this version"
            raise RecordingError(f"{recording.source}: {fault}") from None


class _DifferentError(RecordingError):
    """A recording that does not re-simulate."""


def restoring(
    recording: Recording,
    now: float,
    patience: float,
    world_of: Callable[[Task], World] = World,
) -> Generator[None, None, Restored]:
    """Do `restore` frame by frame, so that a server can do other work in between."""
    restoration = Restoration(recording, now, world_of)
    yield from restoration.replay()
    return restoration.finish(now, patience)


class Restoration:
    """Recovery of an episode in parts, also from a recording that still grows.

    The frames are verified and restored in one pass, so that each is decoded and re-simulated once.

    Attributes:
        recording: The recording.

    Raises:
        RecordingError: The recording has invalid rules.
    """

    def __init__(
        self, recording: Recording, now: float, world_of: Callable[[Task], World] = World
    ) -> None:
        recording.world = world_of(recording.task)
        self.recording = recording
        self._comparison = Comparison(recording)
        treatments = _treatments(recording)
        self._episode = Episode(recording.world, _rules(recording), now, treatments=treatments)
        self._replayer = _Replayer(self._episode.record)
        # The re-simulation never asks for a frame that is not there yet.
        self._frames = deque[dict[str, Any]]()
        self._resimulated = recording.resimulated_frames(_taken_from(self._frames))
        self._done, self._position = 0, len(MAGIC)

    def replay(self, *, but_last: int = 0) -> Generator[None, None, None]:
        """Replay the next frames, except the last ones.

        Raises:
            RecordingError: The recording does not re-simulate.
        """
        recording = self.recording
        frames = recording.frames_from(self._position)
        for frame, end in islice(frames, max(0, recording.count - but_last - self._done)):
            self._frames.append(frame)
            _, _, written = next(self._resimulated)
            self._comparison.add(written)
            if not self._comparison.same:
                raise _DifferentError(f"{recording.source}: does not re-simulate")
            self._replayer.frame(recording, frame)
            self._done, self._position = self._done + 1, end
            yield

    def continue_with(self, longer: Recording) -> bool:
        """Go on with a recording that has more frames; return False if it begins differently."""
        longer.world = self.recording.world
        self.recording = longer
        return not self._comparison.missing and self._comparison.continue_with(longer)

    def finish(self, now: float, patience: float) -> Restored:
        """Return the episode. It waits for its participants for `patience` seconds.

        Raises:
            RecordingError: The recording does not re-simulate.
        """
        recording, episode, replayer = self.recording, self._episode, self._replayer
        if not self._comparison.reaches_the_end:
            raise _DifferentError(f"{recording.source}: does not re-simulate")
        outcome = recording.outcome
        if outcome is not None:
            episode.restore_ended(_outcome(recording, outcome))
        else:
            episode.step_began = now
            episode.resume_after_restart(
                now,
                elapsed=replayer.milliseconds / 1000,
                patience=patience,
                expected=replayer.expected,
                paused=PauseReason.OPERATOR in replayer.pauses,
            )
        missing, said = self._comparison.missing, tuple(replayer.said)
        return Restored(episode, recording.whole, missing, said, outcome is not None)


def _taken_from(frames: deque[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    while frames:
        yield frames.popleft()


def _outcome(recording: Recording, row: dict[str, Any]) -> Outcome:
    try:
        return Outcome.from_json(row)
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{recording.source}: the outcome: {error}") from None


def _rules(recording: Recording) -> Rules:
    try:
        return rules_in(recording.header)
    except RecordingError as error:
        raise RecordingError(f"{recording.source}: {error}") from None


def _treatments(recording: Recording) -> dict[str, SeatTreatment]:
    rows = recording.header.get("treatments", {})
    return {player: SeatTreatment.model_validate(row) for player, row in rows.items()}


class _Replayer:
    """Applies the frames of a recording to the record of an episode, without reporting events."""

    def __init__(self, record: EpisodeRecord) -> None:
        self.record = record
        self.milliseconds = 0
        self.said: list[dict[str, Any]] = []
        self.pauses: list[str] = []
        self.expected: set[str] = set()

    def frame(self, recording: Recording, frame: dict[str, Any]) -> None:
        if frame["kind"] == "step":
            self.milliseconds = max(self.milliseconds, frame["t"])
            self._step(frame, recording.actions(frame))
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                self.milliseconds = max(self.milliseconds, note["t"])
                self._note(note)
        # These events are in the recording already. Clients that return get a snapshot.
        self.record.events.clear()

    def _step(self, frame: dict[str, Any], actions: list[GroundAction]) -> None:
        idle = tuple((str(player), int(seq)) for player, seq in frame.get("idle", ()))
        moves = tuple(
            PlayedMove(
                row["player"],
                action,
                row["seq"],
                row["ms"] / 1000,
                row.get("reasoning", ""),
                row.get("basis"),
            )
            for row, action in zip(frame["moves"], actions, strict=True)
        )
        for player, seq in [*((move.player, move.seq) for move in moves), *idle]:
            seat = self._seat(player)
            # Numbers survive a restart: a client that sends its last action again must get the
            # recorded result and not act twice.
            seat.seq = max(seat.seq, seq)
        for move in moves:
            self._seat(move.player).quota.take(len(move.reasoning.encode()))
        for player, seq in idle:
            self._seat(player).answer = ActionAnswer(seq, self.record.step + 1)
        undone = [tuple(atom) for atom in frame.get("undone", ())]
        waits = tuple(frame.get("waits", ()))
        self.record.take_step(moves, idle, waits, frame["t"] / 1000, undone)

    def _note(self, note: dict[str, Any]) -> None:
        record, time = self.record, note["t"] / 1000
        match note["note"]:
            case "roster":
                record.used = True
                _sit(self._seat(note["player"]), note, record.stopwatch.read(time))
                if note["present"] or not note["taken"]:
                    self.expected.discard(note["player"])
            case "ready":
                self._seat(note["player"]).ready = note["ready"]
            case "rejected":
                self._rejected(self._seat(note["player"]), note)
            case "said":
                self.said.append(note)
                record.said += 1
                size = NOTE_BYTES + len(note["name"].encode()) + len(note["text"].encode())
                self._quota(note).take(size)
                if note["player"]:
                    self._seat(note["player"]).tally.said += 1
            case "noted":
                self._quota(note).take(size_of_note(note["topic"], note["text"]))
            case "quota":
                self._quota(note).reached = True
            case "moderated":
                what = Moderation(note["what"])
                record.apply_moderation(what, note["session"], note["participant"])
            case "paused":
                self.pauses = note["holds"]
                record.stopwatch.stop(time)
            case "resumed":
                self.pauses = []
                record.stopwatch.go_on(time)
            case "restarted":
                # Participants who have not come back since an earlier restart are still expected:
                # two restarts in a row must not make them absent.
                self.expected |= {seat.player for seat in record.seats.values() if seat.present}
            case "started" if record.phase is Phase.WAITING:
                record.start()

    def _rejected(self, seat: Seat, note: dict[str, Any]) -> None:
        reasons, code = tuple(note["reasons"]), note.get("code", ACTION_INVALID)
        if note.get("heard", True):
            seat.seq = max(seat.seq, note["seq"])
            seat.answer = ActionAnswer(note["seq"], self.record.step, reasons, code)
        seat.count_rejection(rejection_kind(note))
        texts = [note["action"], note.get("text", ""), *reasons]
        for why in note.get("why", ()):
            texts += [why.get("predicate", ""), *why.get("objects", ())]
        seat.quota.take(size_of_rejection(texts))
        seat.quota.take(len(note.get("reasoning", "").encode()))

    def _quota(self, note: dict[str, Any]) -> Quota:
        player = note["player"]
        return self._seat(player).quota if player else self.record.audience_quota

    def _seat(self, player: str) -> Seat:
        try:
            return self.record.seats[player]
        except KeyError:
            raise RecordingError(f"a frame refers to an unknown seat {player!r}") from None


def _sit(seat: Seat, note: dict[str, Any], ran: float) -> None:
    """Bring a seat into the state of a roster note, after the game has run for `ran` seconds."""
    if note["taken"]:
        # A participant who returns, in the same session or a new one, keeps the numbers of the
        # requests and the last answer.
        if seat.taken and seat.participant != note["participant"]:
            seat.vacate(ran)
        if seat.taken:
            seat.change_session(note["session"], note["kind"])
        else:
            seat.take(note["name"], note["kind"], note["session"], note["participant"], ran)
        seat.generation, seat.agent = note["generation"], note.get("agent", "")
        if note["present"]:
            seat.come_back(ran)
        elif seat.present:
            seat.lose_connection(ran)
    elif seat.taken:
        seat.vacate(ran)
    seat.controller = controller_of(note)
