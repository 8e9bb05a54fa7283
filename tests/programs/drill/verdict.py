"""Comparison of the recordings with the messages that clients received."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from robotouille.errors import RobotouilleError
from robotouille.replay.recording import Recording, read_recording

__all__ = ["Verdict", "judge"]

LOST = ("seat/lost", "episode/ended")
"""Codes of replies that do not reveal what happened to an action."""
FINISHED = ("goal", "step_limit")
UNBEGUN = {"reason": "aborted", "steps": 0, "detail": "the server shuts down"}
"""Outcome of an episode that had not started when the server received a SIGTERM."""

Row = list[Any]


@dataclass(slots=True)
class Verdict:
    """Results of the comparison; `faults` is empty if everything agrees.

    `unheard` counts chat messages sent into a connection that was just lost. `unaware` counts
    spectators who returned after the end. The server guarantees nothing in either case.
    `lost` contains the players whose actions were refused because they had lost their seat.
    `restarted` counts the restarts of games by their players and their phase, for example
    `pages running`.
    """

    games: int = 0
    others: int = 0
    steps: int = 0
    verified: int = 0
    states: int = 0
    deltas: int = 0
    actions: int = 0
    chat: int = 0
    unheard: int = 0
    unaware: int = 0
    lost: list[str] = field(default_factory=list)
    outcomes: Counter[str] = field(default_factory=Counter)
    controllers: Counter[str] = field(default_factory=Counter)
    restarts: Counter[int] = field(default_factory=Counter)
    restarted: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)


def judge(recordings: Path | Sequence[Path], evidence: Path) -> Verdict:
    """Check every recording, and compare it with every line that a client has written.

    Args:
        recordings: The folder of the recordings, or those of several nodes. Two nodes may have the
            same recording, but not different ones of one episode.
        evidence: The folder of the clients' lines.
    """
    verdict = Verdict()
    told: dict[str, list[Path]] = {}
    for path in sorted(evidence.glob("*.jsonl")):
        told.setdefault(path.name.split("-")[0], []).append(path)
    folders = [recordings] if isinstance(recordings, Path) else recordings
    found = (path for folder in folders for path in folder.glob("*"))
    judged: dict[str, Path] = {}
    for path in sorted(found, key=lambda path: path.name):
        if path.suffix != ".rbt":
            verdict.faults.append(f"{path.name} is left behind")
            continue
        if path.name in judged:
            if path.read_bytes() != judged[path.name].read_bytes():
                verdict.faults.append(f"{path.name} differs between two nodes")
            continue
        judged[path.name] = path
        episode = path.stem.rpartition("_")[2]
        _judge_game(verdict, path, told.pop(episode, []))
    for episode, paths in told.items():
        names = ", ".join(path.name for path in paths)
        verdict.faults.append(f"episode {episode} has no recording; its clients: {names}")
    return verdict


def _judge_game(verdict: Verdict, path: Path, told: list[Path]) -> None:
    try:
        recording = read_recording(path)
        found = recording.verify()
    except RobotouilleError as error:
        verdict.faults.append(f"{path.name}: {error}")
        return
    if not (found.ok and found.complete):
        verdict.faults.append(f"{path.name}: {found}")
        return
    verdict.verified += 1
    verdict.steps += found.steps
    if not told:
        verdict.others += 1
        return
    verdict.games += 1
    record = _Record(recording)
    verdict.outcomes[record.outcome["reason"]] += 1
    verdict.controllers.update(record.controllers)
    verdict.restarts[len(record.restarts)] += 1
    verdict.restarted.update(f"{record.company} {phase}" for phase in record.restarts)
    if record.outcome["reason"] not in FINISHED and not UNBEGUN.items() <= record.outcome.items():
        verdict.faults.append(f"{path.name}: ended with {record.outcome}")
    verdict.faults += [f"{path.name}: {fault}" for fault in record.doubles()]
    for witness in told:
        rows = [json.loads(line) for line in witness.read_text(encoding="utf-8").splitlines()]
        faults = _Trial(record, rows, verdict).faults()
        verdict.faults += [f"{witness.name}: {fault}" for fault in faults]


class _Record:
    """A recording, indexed for the comparison."""

    def __init__(self, recording: Recording) -> None:
        self.players = recording.world.players
        self.outcome: dict[str, Any] = recording.outcome or {}
        self.digests = {step: state.digest for step, state in recording.states()}
        self.moves = {frame["step"]: frame["moves"] for frame in recording.steps}
        self.unmet = {
            frame["step"]: sorted(int(row) for row in frame.get("unmet", {}))
            for frame in recording.steps
        }
        notes = list(recording.notes())
        self.said = [note for note in notes if note["note"] == "said"]
        self.restarts = list(_phases_at_restarts(notes))
        self.company = _company(notes)
        self.controllers = Counter(
            note["controller"] or "free" for note in notes if note["note"] == "roster"
        )
        self.acted: dict[tuple[str, str, int], list[tuple[int, Row, bool]]] = {}
        self._lay_out_actions(recording)

    def _lay_out_actions(self, recording: Recording) -> None:
        """Index each action by the seat's participant, the seat, and the sequence number."""
        holder = dict.fromkeys(self.players, "")
        for frame in recording.frames:
            if frame["kind"] == "notes":
                for note in frame["notes"]:
                    if note["note"] == "roster":
                        holder[note["player"]] = note["name"]
            elif frame["kind"] == "step":
                for number, move in enumerate(frame["moves"]):
                    key = (holder[move["player"]], move["player"], move["seq"])
                    applied = number not in self.unmet[frame["step"]]
                    row = (frame["step"], move["action"], applied)
                    self.acted.setdefault(key, []).append(row)

    def doubles(self) -> Iterable[str]:
        """Yield actions that were applied in more than one step, and duplicate chat messages."""
        for (name, player, seq), rows in self.acted.items():
            if seq > 0 and len(rows) > 1:
                yield f"action {seq} of {name} at {player} was applied {len(rows)} times: {rows}"
        texts = Counter(note["text"] for note in self.said)
        for text, count in texts.items():
            if count > 1:
                yield f"{text!r} is in the recording {count} times"


def _phases_at_restarts(notes: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the phase of a game at each restart of the server."""
    phase = "waiting"
    for note in notes:
        match note["note"]:
            case "countdown":
                phase = "countdown" if "ms" in note else "waiting"
            case "started" | "resumed":
                phase = "running"
            case "paused":
                phase = "paused"
            case "restarted":
                yield phase
                # The server counts down again.
                phase = "waiting" if phase == "countdown" else phase


def _company(notes: list[dict[str, Any]]) -> str:
    """Return who plays a game: people with `pages` or `windows`, or `bots` only."""
    people = [note for note in notes if note["note"] == "roster" and note["kind"] == "human"]
    if any(note.get("agent") == "browser" for note in people):
        return "pages"
    return "windows" if people else "bots"


class _Trial:
    """Comparison of one client's evidence with a recording."""

    def __init__(self, record: _Record, rows: list[Row], verdict: Verdict) -> None:
        self._record = record
        self._rows = rows
        self._verdict = verdict
        self._seat = rows[0][2]
        self._name = rows[0][3]
        self._heard: set[str] = set()

    def faults(self) -> Iterable[str]:
        """Yield each message that the recording does not confirm."""
        checks = {
            "state": self._state, "delta": self._delta, "said": self._said, "act": self._act,
            "over": self._over, "game": lambda _: "", "says": lambda _: "",
        }  # fmt: skip
        for row in self._rows:
            fault = checks[row[0]](row)
            if fault:
                yield fault
        if self._rows[-1][0] != "over":
            yield "the client never saw the end"
        says = {row[1] for row in self._rows if row[0] == "says"}
        self._verdict.unheard += len(says - self._heard)

    def _state(self, row: Row) -> str:
        _, step, digest = row
        self._verdict.states += 1
        recorded = self._record.digests.get(step)
        return "" if recorded == digest else f"step {step} had hash {digest}, recorded {recorded}"

    def _delta(self, row: Row) -> str:
        _, step, did, seqs, unmet = row
        self._verdict.deltas += 1
        if step not in self._record.moves:
            return f"step {step} is lost: the recording ends at {max(self._record.digests)}"
        recorded = [
            [self._record.players.index(move["player"]), *move["action"]]
            for move in self._record.moves[step]
        ]
        if recorded != did:
            return f"step {step} contains {did}, recorded {recorded}"
        if [move["seq"] for move in self._record.moves[step]] != seqs:
            return f"step {step} has other sequence numbers than {seqs}"
        if self._record.unmet[step] != unmet:
            return f"step {step} rejected {unmet}, recorded {self._record.unmet[step]}"
        return ""

    def _said(self, row: Row) -> str:
        _, number, name, seat, text = row
        self._verdict.chat += 1
        self._heard.add(text)
        said = self._record.said
        if not 1 <= number <= len(said):
            return f"chat message {number} ({text!r}) is lost: {len(said)} are recorded"
        note = said[number - 1]
        if (note["name"], note["player"], note["text"]) != (name, seat, text):
            return f"chat message {number} was {text!r} from {name}, recorded {note['text']!r}"
        return ""

    def _act(self, row: Row) -> str:
        _, seq, action, applied, step, code = row
        self._verdict.actions += 1
        if code == "seat/lost" and self._name not in self._verdict.lost:
            self._verdict.lost.append(self._name)
        found = self._record.acted.get((self._name, self._seat, seq), [])
        if action is None:
            return f"action {seq} was null, recorded {found}" if found else ""
        if applied:
            if [(at, what) for at, what, ok in found if ok] != [(step, action)]:
                return f"action {seq} {action} applied in step {step}, recorded {found}"
        elif code not in LOST and any(ok for _, _, ok in found):
            return f"action {seq} {action} was rejected ({code}), recorded {found}"
        return ""

    def _over(self, row: Row) -> str:
        _, outcome, why = row
        if why and self._seat is None:
            self._verdict.unaware += 1
            return ""
        if why:
            return why
        if outcome != self._record.outcome:
            return f"ended with {outcome}, recorded {self._record.outcome}"
        return ""
