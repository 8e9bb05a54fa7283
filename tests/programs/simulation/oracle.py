"""The recordings, read while they are written, as the reference for all clients.

The oracle decodes each byte that reaches the disk and simulates the episode again in its own world.
It can therefore check a client at any moment: whatever a client receives must already be recorded.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, MutableMapping
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

from robotouille.domain.task import Task
from robotouille.replay.compression import unwrap
from robotouille.replay.container import MAGIC, frame_ends, frame_value
from robotouille.replay.recording import Recording
from robotouille.world.world import State, World
from robotouille_client import Game

__all__ = ["EpisodeTruth", "Oracle", "RecordedMove"]

Fail = Callable[[str], None]


class RecordedMove(NamedTuple):
    """A move of a step, and its tenure (the participant's stay in the seat)."""

    player: str
    action: tuple[str, ...]
    seq: int
    tenure: str
    applied: bool


class EpisodeTruth:
    """One episode according to its recording so far."""

    def __init__(self, name: str, fail: Fail, worlds: MutableMapping[str, World]) -> None:
        self.name = name
        self.header: dict[str, Any] = {}
        self.states: list[State] = []
        self.moves: list[tuple[RecordedMove, ...]] = [()]
        self.tenures: list[dict[str, str]] = [{}]
        self.said: list[dict[str, Any]] = []
        self.notes: list[dict[str, Any]] = []
        self.outcome: dict[str, Any] | None = None
        self.seen = -1
        self.content = bytearray()
        self.closed = False
        self.discarded = False
        self._tenures: dict[str, tuple[str, int]] = {}
        self._acted: set[tuple[str, str, int]] = set()
        self._digests: dict[int, str] = {}
        self._parsed = 0
        self._fail = fail
        self._worlds = worlds

    @property
    def episode(self) -> str:
        return str(self.header.get("episode", ""))

    @property
    def over(self) -> bool:
        """Return whether the episode has ended or was discarded without participants."""
        return self.outcome is not None or self.discarded

    @property
    def begun(self) -> bool:
        return any(note["note"] == "started" for note in self.notes)

    @property
    def step(self) -> int:
        """Return the last recorded step."""
        return len(self.states) - 1

    def digest(self, step: int) -> str:
        """Return the hash of the state at a step."""
        if step not in self._digests:
            self._digests[step] = self.states[step].digest
        return self._digests[step]

    def append(self, at: int, data: bytes) -> None:
        if at != len(self.content):
            self._fail(f"{self.name}: write at byte {at}, but the file has {len(self.content)}")
        self.content += data
        self._parse()

    def cut(self, size: int) -> None:
        """Cut off the end, as a restarted server does; only torn frames may be lost."""
        if size < self._parsed:
            lost = self._parsed - size
            self._fail(
                f"{self.name}: {lost} bytes of whole frames were cut off (step {self.step}, "
                f"clients have seen {self.seen})"
            )
        del self.content[size:]

    def _parse(self) -> None:
        if not self._parsed:
            if len(self.content) < len(MAGIC):
                return
            self._parsed = len(MAGIC)
        for end in frame_ends(self.content, self._parsed):
            self._frame(frame_value(self.content, self._parsed, end))
            self._parsed = end

    def _frame(self, frame: dict[str, Any]) -> None:
        if self.outcome is not None:
            self._fail(f"{self.name}: frame after the end: {frame['kind']}")
        match frame["kind"]:
            case "header":
                self._begin(frame)
            case "step":
                self._step(frame)
            case "notes":
                for note in frame["notes"]:
                    self._note(note)
            case "footer":
                self.outcome = frame["outcome"]
            case "state":
                if frame["hash"] != self.digest(frame["step"]):
                    self._fail(f"{self.name}: keyframe {frame['step']} has another hash")

    def _begin(self, frame: dict[str, Any]) -> None:
        self.header = frame
        world = self._worlds.get(frame["digest"])
        if world is None:
            task = Task.from_json(frame["task"], self.name)
            world = self._worlds[frame["digest"]] = World(task)
        self.states.append(world.initial)

    def _step(self, frame: dict[str, Any]) -> None:
        if frame["step"] != self.step + 1:
            self._fail(f"{self.name}: step {frame['step']} follows step {self.step}")
            return
        state = self.states[-1]
        actions = [state.world.action(*move["action"]) for move in frame["moves"]]
        result = state.step(actions)
        self.states.append(result.state)
        moves = tuple(
            RecordedMove(
                move["player"],
                tuple(move["action"]),
                move["seq"],
                self.tenure(move["player"]),
                attempt.applied,
            )
            for move, attempt in zip(frame["moves"], result.attempts, strict=True)
        )
        self.moves.append(moves)
        self.tenures.append({player: self.tenure(player) for player in self._tenures})
        for move in moves:
            self._check_once(move)
        if frame.get("hash") and frame["hash"] != self.digest(self.step):
            self._fail(f"{self.name}: step {self.step} is recorded with another hash")

    def _check_once(self, move: RecordedMove) -> None:
        """Check that no action applies twice; substitutes use the number 0."""
        key = (move.player, move.tenure, move.seq)
        if move.seq and key in self._acted:
            self._fail(f"{self.name}: {move.player} acted twice with number {move.seq}")
        self._acted.add(key)

    def tenure(self, player: str) -> str:
        """Return the seat's participant, with a count of the stays in the seat."""
        who, count = self._tenures.get(player, ("", 0))
        return f"{who}#{count}"

    def check_end(self) -> None:
        """Check that the recording is complete and verifies."""
        if self.discarded:
            return
        if self.outcome is None:
            self._fail(f"{self.name}: the recording has no end (step {self.step})")
            return
        verification = Recording(bytes(self.content), self.name).verify()
        if not (verification.ok and verification.complete):
            self._fail(f"{self.name}: verification failed: {verification}")

    def _note(self, note: dict[str, Any]) -> None:
        self.notes.append({"step": self.step, **note})
        if note["note"] == "said":
            self.said.append(note)
        if note["note"] == "roster":
            who, count = self._tenures.get(note["player"], ("", 0))
            taken = note.get("taken", True)
            sitting = (note.get("session") or note["name"]) if taken else ""
            if sitting != who:
                self._tenures[note["player"]] = (sitting, count + 1)


class Oracle:
    """All episodes of a simulation."""

    def __init__(self, fail: Fail) -> None:
        self.files: dict[str, EpisodeTruth] = {}
        self.counts: Counter[str] = Counter()
        self._by_id: dict[str, EpisodeTruth] = {}
        self._fail = fail
        self._worlds: WeakValueDictionary[str, World] = WeakValueDictionary()

    # Reports of the disk

    def appended(self, name: str, at: int, data: bytes) -> None:
        truth = self.files.get(name)
        if truth is None:
            truth = self.files[name] = EpisodeTruth(name, self._fail, self._worlds)
        truth.append(at, data)

    def cut(self, name: str, size: int) -> None:
        truth = self.files.get(name)
        if truth is not None:
            truth.cut(size)

    def replaced(self, name: str, content: bytes) -> None:
        """Check that a closed recording contains exactly what was appended."""
        truth = self.files.get(f"{name}.part")
        if truth is None:
            return
        truth.closed = True
        if unwrap(content) != bytes(truth.content):
            self._fail(f"{name}: the closed file differs from the appended content")
        if truth.outcome is None:
            self._fail(f"{name}: closed without an outcome")

    def removed(self, name: str) -> None:
        """Check that a removed file has a closed form or never had participants."""
        truth = self.files.get(name)
        if truth is None or truth.closed:
            return
        truth.discarded = True
        if truth.seen >= 0 or any(note["note"] == "roster" for note in truth.notes):
            self._fail(f"{name}: deleted, although the episode had participants")

    # Queries and checks

    def of_code(self, code: str | None) -> EpisodeTruth | None:
        """Return the episode with this code."""
        return next((t for t in self.files.values() if t.header.get("code") == code), None)

    def find(self, episode: str) -> EpisodeTruth | None:
        truth = self._by_id.get(episode)
        if truth is None:
            truth = next((t for t in self.files.values() if t.episode == episode), None)
            if truth is not None:
                self._by_id[episode] = truth
        return truth

    def forget(self, truth: EpisodeTruth) -> None:
        """Discard an episode that has ended and was checked."""
        self.files.pop(truth.name, None)
        self._by_id.pop(truth.episode, None)

    def check_state(self, who: str, episode: str, step: int, digest: str) -> None:
        """Check the state that a client has at a step."""
        self.counts["states"] += 1
        truth = self.find(episode)
        if truth is None:
            self._fail(f"{who}: sees episode {episode}, which is not recorded")
        elif step > truth.step:
            self._fail(f"{who}: sees step {step} of {episode}, recorded are {truth.step}")
        elif truth.digest(step) != digest:
            self._fail(f"{who}: step {step} of {episode} differs from the recorded state")
        else:
            truth.seen = max(truth.seen, step)

    def said_since(self, episode: str, number: int) -> int:
        """Return the number of chat messages after `number`."""
        truth = self.find(episode)
        return len(truth.said) - number if truth is not None else 0

    def check_said(self, who: str, episode: str, text: str) -> None:
        """Check a chat message that a client received."""
        self.counts["heard"] += 1
        truth = self.find(episode)
        recorded = [note["text"] for note in truth.said] if truth else []
        if recorded.count(text) != 1:
            self._fail(f"{who}: received {text!r}, recorded {recorded.count(text)} times")

    def check_applied(
        self, who: str, game: Game, seat: str, seq: int, step: int, action: Any, *, exactly: bool
    ) -> None:
        """Check a reply that an action of a seat was applied in a step (None for no action).

        A client that only receives text may learn it later, about a step during its absence.
        Sequence numbers restart with each tenure of a seat.
        """
        self.counts["applied"] += 1
        truth = self.find(game.episode)
        if truth is None or step > truth.step:
            self._fail(f"{who}: action {seq} applied in step {step}, which is not recorded")
            return
        steps = truth.moves[step : step + 1] if exactly else truth.moves[: step + 1]
        applied = [m for moves in steps for m in moves if m.applied]
        tenure = truth.tenures[step].get(seat)
        found = any((m.player, m.seq, m.tenure) == (seat, seq, tenure) for m in applied)
        if found != (action is not None):
            self._fail(
                f"{who}: action {seq} ({action}) was reported for step {step} of "
                f"{game.episode}, recorded are {truth.moves[step]}"
            )
