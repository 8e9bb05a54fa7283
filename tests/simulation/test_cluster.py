"""Short simulations of a cluster, and deliberate faults that they find."""

from __future__ import annotations

import asyncio
import gc
import warnings
from collections import Counter
from collections.abc import Callable, Coroutine, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import pytest

from robotouille.episode import Event, Stepped
from robotouille_server.cluster.bus import BusError, ConflictError, Stored, UnavailableError
from robotouille_server.cluster.episodes.directory import Directory
from robotouille_server.cluster.episodes.journal import ReplicatedJournal
from robotouille_server.cluster.members import Members, _Member
from tests.programs.simulation.cluster import run_cluster_seed
from tests.programs.simulation.simulation import Report
from tests.support.buses import SimulatedBus, SimulatedNats
from tests.support.samples import quick_sample
from tests.support.virtual_time import virtual

Plant = Callable[[pytest.MonkeyPatch], None]
BLOCK = 5
LAST = 200


def failure_text(report: Report) -> str:
    again = f"reproduce: python -m tests.programs.simulation.cluster --seed {report.seed} --trace"
    return "\n".join([again, *report.faults])


@pytest.mark.parametrize("start", quick_sample(range(0, LAST, BLOCK), nightly=10))
def test_episodes_survive_the_faults_of_a_cluster(start: int) -> None:
    reports = [run_cluster_seed(seed) for seed in range(start, start + BLOCK)]
    failed = [failure_text(report) for report in reports if not report.ok]
    assert not failed, "\n\n".join(failed)
    counts: Counter[str] = Counter()
    for report in reports:
        counts.update(report.counts)
    assert counts["recordings"] == 2 * BLOCK
    assert min(counts["steps"], counts["messages"]) > 10 * BLOCK, "too little was checked"


@pytest.mark.slow
def test_seed_gives_the_same_course_again() -> None:
    """The course must not depend on hashes, addresses or earlier runs."""
    assert run_cluster_seed(7).digest == run_cluster_seed(7).digest
    assert run_cluster_seed(7).digest != run_cluster_seed(8).digest


def test_node_that_leaves_after_a_suspension_hands_over_nothing_that_others_have() -> None:
    report = run_cluster_seed(900_321)
    assert report.ok, failure_text(report)


@virtual
async def test_node_that_dies_when_a_request_arrives_begins_no_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nats, begun = SimulatedNats(), list[str]()
    start = nats.loop.create_task

    async def answer(word: str, data: bytes) -> bytes:
        begun.append(word)
        return b""

    def start_and_die(work: Coroutine[Any, Any, Any], **options: Any) -> asyncio.Task[Any]:
        task = start(work, **options)
        task.cancel()
        return task

    await nats.bus("n1").answer("adopt.n1", answer)
    with warnings.catch_warnings(record=True) as warned, monkeypatch.context() as patch:
        warnings.simplefilter("always")
        patch.setattr(nats.loop, "create_task", start_and_die)
        with pytest.raises(UnavailableError):
            await nats.bus("n2").request("adopt.n1.e1", b"", 1.0)
        gc.collect()
    assert not begun
    assert not [str(each.message) for each in warned], "a coroutine was never awaited"


# Faults that the simulation finds


@dataclass(frozen=True)
class Fault:
    """A fault, a part of its report, and seeds; at least one seed must find the fault."""

    plant: Plant
    seeds: tuple[int, ...]
    says: str


def ignore_conflicts(patch: pytest.MonkeyPatch) -> None:
    """Take a refused write for a written one, so that a node goes on after a takeover."""
    answered = ReplicatedJournal._answered

    def careless(journal: ReplicatedJournal, write: Any, result: int | BusError) -> None:
        number = write.message.expected + 1
        answered(journal, write, number if isinstance(result, ConflictError) else result)

    patch.setattr(ReplicatedJournal, "_answered", careless)


def claim_at_once(patch: pytest.MonkeyPatch) -> None:
    """Claim the episodes of every node that was not heard since the last round."""
    patch.setattr(_Member, "lapsed", property(lambda member: member.left or member.silent > 0))


def claim_everything(patch: pytest.MonkeyPatch) -> None:
    """Claim all episodes that anybody has lost, without a division."""

    def greedy(members: Members, orphans: Mapping[str, str]) -> list[str]:
        return sorted(orphans)

    patch.setattr(Members, "share", greedy)
    patch.setattr(Members, "lapsed", lambda members, name: name != members.own.name)


def publish_before_writing(patch: pytest.MonkeyPatch) -> None:
    """Publish without waiting for the quorum."""
    write = ReplicatedJournal.write

    def hasty(journal: ReplicatedJournal) -> bool:
        write(journal)
        return True

    patch.setattr(ReplicatedJournal, "write", hasty)


def omit_a_step(patch: pytest.MonkeyPatch) -> None:
    """Publish the fourth step without writing it."""
    add = ReplicatedJournal.add

    def sparing(journal: ReplicatedJournal, events: Iterable[Event]) -> None:
        add(journal, [e for e in events if not (isinstance(e, Stepped) and e.step == 4)])

    patch.setattr(ReplicatedJournal, "add", sparing)


def forget_the_last_message(patch: pytest.MonkeyPatch) -> None:
    """Continue an episode without its last message that has content, and cut it off."""
    read = "robotouille_server.cluster.episodes.claims.assembled"

    def careless(messages: list[Stored]) -> bytes:
        return b"".join([message.data for message in messages if message.data][:-1])

    patch.setattr(read, careless)


def trust_the_directory(patch: pytest.MonkeyPatch) -> None:
    """Claim episodes without reading their records again."""

    async def nothing(directory: Directory, code: str) -> None:
        pass

    patch.setattr(Directory, "look", nothing)


def restate_nothing(patch: pytest.MonkeyPatch) -> None:
    """Continue a journal without writing its end again."""
    patch.setattr("robotouille_server.cluster.episodes.claims.RESTATED", 0)


def miss_deleted_buckets(patch: pytest.MonkeyPatch) -> None:
    """Take buckets for those that were there at the start."""

    async def intact(bus: SimulatedBus) -> bool:
        return True

    patch.setattr(SimulatedBus, "intact", intact)


def take_deleted_reports_for_silence(patch: pytest.MonkeyPatch) -> None:
    """Claim the episodes of nodes whose reports were deleted with their bucket."""
    patch.setattr(Members, "missing", lambda members, name: None)


FAULTS = [
    Fault(ignore_conflicts, (2, 49), "recorded"),
    Fault(claim_at_once, (2, 0), "which is alive"),
    Fault(claim_everything, (4, 3), "which is alive"),
    Fault(publish_before_writing, (4, 3), "recorded"),
    Fault(omit_a_step, (4, 1), "recorded"),
    Fault(forget_the_last_message, (2, 6), "not taken over"),
    Fault(trust_the_directory, (59, 154), "has it"),
    Fault(restate_nothing, (1, 10), "or another content"),
    Fault(miss_deleted_buckets, (10, 16), "not filled again"),
    Fault(take_deleted_reports_for_silence, (75882031,), "which is alive"),
]


@pytest.mark.parametrize("fault", quick_sample(FAULTS), ids=lambda fault: fault.plant.__name__)
def test_fault_of_a_cluster_is_found(fault: Fault, monkeypatch: pytest.MonkeyPatch) -> None:
    fault.plant(monkeypatch)
    found: list[str] = []
    for seed in fault.seeds:
        found += run_cluster_seed(seed).faults
        if found:
            break
    assert any(fault.says in what for what in found), found or "the fault was not found"


@pytest.mark.slow
def test_same_seeds_find_nothing_without_a_fault() -> None:
    for seed in sorted({seed for fault in FAULTS for seed in fault.seeds}):
        report = run_cluster_seed(seed)
        assert report.ok, failure_text(report)
