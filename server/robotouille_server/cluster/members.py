"""Members of a cluster: the living nodes, and the choice of a node for an episode.

This is pure logic: time is an argument.

Every node renews a report once a second. A node whose report is not renewed for `LEASE_SECONDS` has
lost its episodes: the others claim them. They may err, because a slow node is like a dead one. So
nothing depends on this but speed: a node that writes to a journal learns whether it still owns the
episode (`episodes/journal.py`).
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, ValidationError

from robotouille.protocol import messages

RENEW_SECONDS = 1.0
LEASE_SECONDS = 3.0
"""Seconds of silence after which other nodes claim a node's episodes."""
LATE_SECONDS = 2.0
"""Seconds of silence after which a node's key is read, in case that only its news are late."""
MAX_REFUSED = 200
"""Episodes named in a report that a node could not continue."""


class NodeReport(BaseModel):
    """Report of a node to the others, once a second.

    Attributes:
        name: The name of the process, new at every start.
        url: The address for clients.
        operator: The address of its operator page, or empty.
        beat: The number of the report; every report has a higher one.
        load: The seats in its episodes that have not ended.
        protocol: The version of the protocol that it speaks.
        release: Its software and version.
        keys: A digest of the keys that sign its tokens.
        tasks: A digest of the operator's own tasks.
        leaving: True if it accepts no more episodes.
        refused: Episodes that it could not continue.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)

    name: str
    url: str
    operator: str = ""
    beat: int = 0
    load: int = 0
    protocol: int = messages.PROTOCOL_VERSION
    release: str = ""
    keys: str = ""
    tasks: str = ""
    leaving: bool = False
    refused: tuple[str, ...] = ()


@dataclass(slots=True)
class _Member:
    """Another node.

    Attributes:
        heard: True after a report since this node's last renewal.
        missed: True if its key was missing once in this silence.
        gone: True if it had lapsed before this node's last renewal.
    """

    report: NodeReport | None = None
    beat: int = 0
    silent: float = 0.0
    heard: bool = False
    left: bool = False
    missed: bool = False
    gone: bool = False

    @property
    def lapsed(self) -> bool:
        return self.left or self.silent >= LEASE_SECONDS


class Members:
    """The nodes of a cluster, as one of them sees them.

    Attributes:
        own: The report of this node.
        certain_since: The time since which no other node can have claimed this node's episodes, as
            long as `certain` is true.
    """

    def __init__(self, own: NodeReport, now: float) -> None:
        self.own = own
        self._others: dict[str, _Member] = {}
        self._renewed = self.certain_since = now
        self._placed: dict[str, int] = {}

    # Reports

    def heard(self, report: NodeReport, beat: int) -> None:
        """Note the report of another node, unless a later one is known already."""
        known = self._others.get(report.name)
        if report.name == self.own.name or (known is not None and known.beat >= beat):
            return
        self._others[report.name] = _Member(report, beat, heard=True)
        self._placed.pop(report.name, None)

    def left(self, name: str) -> None:
        """Note that a node has left deliberately."""
        if name != self.own.name:
            self._others[name] = _Member(left=True)

    def forget_lapsed(self, needed: Container[str]) -> None:
        """Forget the nodes that are gone, except those that have episodes."""
        gone = [name for name, m in self._others.items() if m.lapsed and name not in needed]
        for name in gone:
            del self._others[name]
            self._placed.pop(name, None)

    def renewed(self, now: float) -> None:
        """Note that this node's own report was stored."""
        if not self.certain(now):
            self.certain_since = now
        self._placed.pop(self.own.name, None)
        passed, self._renewed = now - self._renewed, now
        # Silence counts only while the others can hear this node: after a failure of NATS, or after
        # this process was stopped, everybody was silent.
        counts = passed < LEASE_SECONDS
        for member in self._others.values():
            member.gone = member.lapsed
            if member.heard or not counts:
                member.silent = 0.0
            elif not member.silent:
                # The other was possibly heard while this node waited for its own report to be
                # stored. Since then, a whole pause between two rounds has passed.
                member.silent = min(passed, RENEW_SECONDS)
            else:
                member.silent += passed
            member.heard = False

    def lapsing(self) -> list[str]:
        """Return the nodes whose reports are late or missing, except those that have left."""
        return [n for n, m in self._others.items() if m.silent >= LATE_SECONDS and not m.left]

    def missing(self, name: str) -> None:
        """Note that the key of a silent node is missing, though it has not expired yet.

        An operator has deleted the bucket, perhaps with reports that this node would have heard. So
        the other node gets the whole time again, but only once.
        """
        member = self._others.get(name)
        if member is None or member.report is None or member.missed or member.gone:
            return
        member.missed, member.silent = True, 0.0

    def lease_age(self, now: float) -> float:
        """Return the seconds since this node's report was last stored."""
        return now - self._renewed

    def certain(self, now: float) -> bool:
        """Return whether no other node can have claimed this node's episodes."""
        return self.lease_age(now) < LEASE_SECONDS - RENEW_SECONDS / 2

    def alive(self) -> list[NodeReport]:
        """Return the reports of the nodes that are alive, this one included."""
        others = (member.report for member in self._others.values() if not member.lapsed)
        return [self.own, *(report for report in others if report is not None)]

    def last_known(self) -> list[NodeReport]:
        """Return the last reports of all other nodes that have not left."""
        others = self._others.values()
        return [m.report for m in others if m.report is not None and not m.left]

    def heard_of(self, now: float) -> list[tuple[NodeReport, float]]:
        """Return the reports of the nodes that have not left, with the seconds since each.

        This node comes first, then the others by address, also those that have fallen silent.
        """
        others = [
            (member.report, member.silent)
            for member in self._others.values()
            if member.report is not None and not member.left
        ]
        others.sort(key=lambda other: (other[0].url, other[0].name))
        return [(self.own, self.lease_age(now)), *others]

    def find(self, name: str) -> NodeReport | None:
        """Return the report of a node that is alive."""
        if name == self.own.name:
            return self.own
        member = self._others.get(name)
        return member.report if member is not None and not member.lapsed else None

    def lapsed(self, name: str) -> bool:
        """Return whether a node has lost its episodes.

        A node that this one has never heard of gets the same time as one that falls silent.
        """
        if not name:  # Released by its last node.
            return True
        if name == self.own.name:
            return False
        return self._others.setdefault(name, _Member()).lapsed

    # Decisions

    def place(self, seats: int, silent: Container[str] = ()) -> NodeReport:
        """Return the node for a new episode: the one with the least load.

        Nodes with another version or other tasks are left out, because they may lack the task. If
        all candidates are `silent`, this is the own node.
        """
        others = [
            report
            for report in self._candidates()
            if report.name not in silent
            and (report.release, report.tasks) == (self.own.release, self.own.tasks)
        ]
        chosen = min(others, key=self._rank, default=self.own)
        # Until the next report, this node counts what it has placed itself.
        self._placed[chosen.name] = self._placed.get(chosen.name, 0) + seats
        return chosen

    def other(self, episode: str = "") -> NodeReport | None:
        """Return the least loaded other node that may continue an episode."""
        others = [c for c in self._candidates(episode) if c.name != self.own.name]
        if not others:
            return None
        chosen = min(others, key=self._rank)
        self._placed[chosen.name] = self._placed.get(chosen.name, 0) + 1
        return chosen

    def share(self, orphans: Mapping[str, str]) -> list[str]:
        """Return the episodes that this node should claim.

        All nodes compute the same division if they know the same reports. If they do not, two may
        claim one episode, and the journal decides; or none does, and all divide again.

        Args:
            orphans: The nodes that have lost their episodes, by episode.
        """
        loads = {report.name: report.load for report in self.alive()}
        own = []
        for episode in sorted(orphans):
            names = [c.name for c in self._candidates(episode)]
            if not names:
                continue
            chosen = min(names, key=lambda name: (loads[name], name))
            loads[chosen] += 1
            if chosen == self.own.name:
                own.append(episode)
        return own

    def _candidates(self, episode: str = "") -> list[NodeReport]:
        return [
            report
            for report in self.alive()
            if not report.leaving
            and report.protocol == self.own.protocol
            and episode not in report.refused
        ]

    def _rank(self, report: NodeReport) -> tuple[int, str]:
        return report.load + self._placed.get(report.name, 0), report.name


def parse_report(value: bytes) -> NodeReport | None:
    """Return the report in a value, or None if it is not one."""
    try:
        return NodeReport.model_validate_json(value)
    except ValidationError:
        return None
