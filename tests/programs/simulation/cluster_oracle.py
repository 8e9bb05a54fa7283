"""The journals of a cluster, simulated again while they are written, as the reference for nodes."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, MutableMapping
from itertools import pairwise
from typing import Any

from robotouille.episode import ActionRejected, Event, Stepped
from robotouille.episode.events import EpisodeEnded
from robotouille.replay.compression import unwrap
from robotouille.replay.frame_schema import note_of
from robotouille.replay.recording import Recording
from robotouille.world.world import World
from robotouille_server.cluster.bus import Bucket, Stored
from robotouille_server.cluster.episodes.directory import EpisodeRecord
from robotouille_server.cluster.members import LEASE_SECONDS, NodeReport
from tests.programs.simulation.oracle import EpisodeTruth

__all__ = ["ClusterOracle"]

Fail = Callable[[str], None]
CLOCKS = ("utc_ms", "clock_ms", "step")
WORLDS: dict[str, World] = {}
"""Worlds of the few tasks that are played, for all seeds: grounding them takes long."""
RECENT = 6.0
"""Seconds for which a silence explains a claim: reading and restoring an episode take time."""


class ClusterTruth(EpisodeTruth):
    """One episode according to its journal so far."""

    def __init__(self, name: str, fail: Fail, worlds: MutableMapping[str, World]) -> None:
        super().__init__(name, fail, worlds)
        self.purged = False
        self.writer = self.last_id = ""
        self._ids: set[str] = set()
        self.published_steps: dict[int, tuple[str, Any]] = {}
        self._counted = 0
        self._notes: Counter[str] = Counter()

    def stored(self, writer: str, message: Stored) -> None:
        self.last_id = message.id
        # A claim may be given up. The node that goes on writes something else.
        if ".claim." not in message.id:
            self.writer = writer
        # NATS may store an attempt and its repetition if its leader changes in between.
        if message.id in self._ids:
            return
        self._ids.add(message.id)
        data = message.data
        if message.keep is not None:
            # The new owner of a journal writes its end again.
            same = _same(self.content[message.keep :], data)
            self.cut(message.keep + same)
            data = data[same:]
        if data:
            self.append(len(self.content), data)

    def has(self, note: dict[str, Any]) -> bool:
        """Return whether a note is recorded."""
        for known in self.notes[self._counted :]:
            self._notes[_text(known)] += 1
        self._counted = len(self.notes)
        return self._notes[_text(note)] > 0


def _same(content: bytes, data: bytes) -> int:
    """Return the number of first bytes that are the same."""
    pairs = enumerate(zip(content, data, strict=False))
    return next((n for n, (a, b) in pairs if a != b), min(len(content), len(data)))


def _text(note: dict[str, Any]) -> str:
    plain = {key: value for key, value in note.items() if key not in CLOCKS}
    return json.dumps(plain, sort_keys=True)


class ClusterOracle:
    """All journals of a cluster, and the reports of its nodes."""

    def __init__(self, fail: Fail, now: Callable[[], float]) -> None:
        self.truths: dict[str, ClusterTruth] = {}
        self.counts: Counter[str] = Counter()
        self.leaving: set[str] = set()
        self._fail = fail
        self._now = now
        self._reports: defaultdict[str, list[float]] = defaultdict(list)
        self._beats: dict[str, int] = {}
        self._owners: defaultdict[str, list[tuple[float, str]]] = defaultdict(list)

    # Reports of the service

    def stored(self, writer: str, journal: str, message: Stored) -> None:
        truth = self.truths.get(journal)
        if truth is None:
            truth = self.truths[journal] = ClusterTruth(journal, self._fail, WORLDS)
        if truth.purged:
            self._fail(f"{writer} writes to the deleted journal {journal}")
        truth.stored(writer, message)
        self.counts["messages"] += 1

    def purged(self, journal: str) -> None:
        truth = self.truths[journal]
        truth.purged = True
        if truth.outcome is None and truth.published_steps:
            self._fail(f"the journal {journal} was deleted at step {truth.step}")

    def set(self, bucket: Bucket, key: str, value: bytes | None) -> None:
        if bucket is Bucket.NODES and value is None:
            self.leaving.add(key)
        elif bucket is Bucket.NODES and value is not None:
            self._reported(NodeReport.model_validate_json(value))
        elif bucket is Bucket.EPISODES and value is not None:
            record = EpisodeRecord.model_validate_json(value)
            self._owners[record.episode].append((self._now(), record.node))

    def _reported(self, report: NodeReport) -> None:
        # A copy of an earlier report, which arrives late, is no sign of life.
        if report.beat > self._beats.get(report.name, 0):
            self._beats[report.name] = report.beat
            self._reports[report.name].append(self._now())
        if report.leaving:
            self.leaving.add(report.name)

    def claims(self, node: str, journal: str, believed: str, read: float) -> None:
        """Check that a node claims an episode only from a node that was silent or has left.

        `believed` is the owner in the node's copy of the directory. The node asked for this record
        at the time `read`, and it may have changed since then.
        """
        truth = self.truths.get(journal)
        if truth is not None and truth.last_id.startswith(f"{journal}.{node}.claim."):
            return  # The claim goes on.
        self.counts["claims"] += 1
        owners = self._owners[journal]
        owner = owners[-1][1] if owners else ""
        if believed != owner:
            self.counts["claims by an outdated record"] += 1
            ends = [end for (_, was), (end, _) in pairwise(owners) if was == believed]
            if max(ends, default=0.0) < read:
                self._fail(f"{node} claims {journal} of {believed}, but {owner} has it")
        if believed in ("", node) or believed in self.leaving:
            return
        now = self._now()
        times = [*self._reports[believed], now]
        gaps = ((b, b - a) for a, b in pairwise(times))
        if not any(end >= now - RECENT and gap > LEASE_SECONDS - 0.01 for end, gap in gaps):
            self._fail(f"{node} claims {journal} of {believed}, which is alive")

    # Reports of the rooms

    def answers(self, node: str, journal: str) -> None:
        """Check that no other node has continued an episode that a node is sure to own."""
        self.counts["answers"] += 1
        truth = self.truths.get(journal)
        if truth is not None and truth.writer != node:
            self._fail(f"{node} is sure to own {journal}, but {truth.writer} has it")

    def published(self, node: str, journal: str, events: Iterable[Event]) -> None:
        """Check that everything that a node publishes is recorded."""
        truth = self.truths.get(journal)
        for event in events:
            self.counts["events"] += 1
            if truth is None:
                self._fail(f"{node} publishes {event} of {journal}, which is not recorded")
            elif isinstance(event, Stepped):
                self._check_step(node, truth, event)
            elif isinstance(event, EpisodeEnded):
                if truth.outcome != event.outcome.to_json():
                    self._fail(f"{node} ends {journal} with {event.outcome}, which is not recorded")
            elif isinstance(event, ActionRejected) and not event.recorded:
                continue
            elif not truth.has(note := note_of(event, {})):
                self._fail(f"{node} publishes {note} of {journal}, which is not recorded")

    def _check_step(self, node: str, truth: ClusterTruth, event: Stepped) -> None:
        self.counts["steps"] += 1
        content = [(m.player, (m.action.name, *m.action.arguments), m.seq) for m in event.moves]
        earlier = truth.published_steps.setdefault(event.step, (node, content))
        if earlier[1] != content:
            self._fail(f"step {event.step} of {truth.name} differs at {node} and {earlier[0]}")
        if event.step > truth.step:
            self._fail(
                f"{node} publishes step {event.step} of {truth.name}, recorded are {truth.step}"
            )
        elif [(m.player, m.action, m.seq) for m in truth.moves[event.step]] != content:
            self._fail(f"{node} publishes a step {event.step} of {truth.name} that is not recorded")
        elif truth.digest(event.step) != event.state.digest:
            self._fail(f"{node} publishes another state {event.step} of {truth.name}")

    # The end

    def check_file(self, journal: str, files: dict[str, bytes]) -> None:
        """Check that an ended episode has one recording, and that it verifies."""
        truth = self.truths[journal]
        self._check_whole(truth)
        found = [content for name, content in files.items() if journal in name]
        if [unwrap(content) for content in found] != [bytes(truth.content)]:
            self._fail(f"{len(found)} files of {journal}, or another content")
        if truth.step < max(truth.published_steps, default=0):
            self._fail(f"steps of {journal} were published and are lost")
        self.counts["recordings"] += 1

    def _check_whole(self, truth: ClusterTruth) -> None:
        if truth.outcome is None:
            self._fail(f"the recording of {truth.name} has no end")
            return
        recording = Recording(bytes(truth.content), truth.name)
        world = WORLDS[truth.header["digest"]]
        recording.__dict__ |= {"world": world, "task": world.task}
        verification = recording.verify()
        if not (verification.ok and verification.complete):
            self._fail(f"the recording of {truth.name} does not verify: {verification}")
