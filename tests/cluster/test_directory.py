"""Directory of the episodes of a cluster."""

from __future__ import annotations

import asyncio
import random

import pytest
from structlog.testing import capture_logs

from robotouille.errors import ProtocolError
from robotouille_server.cluster.bus import Bucket, ConflictError, Entry, UnavailableError
from robotouille_server.cluster.episodes.directory import ClusterSlot, Directory, EpisodeRecord
from robotouille_server.cluster.members import Members, NodeReport
from robotouille_server.runtime.workers import ElsewhereError
from tests.programs.simulation.loop import SimulatedLoop
from tests.support.buses import Quality, SimulatedNats
from tests.support.virtual_time import virtual

ID = "0123456789abcdef"
CODE = "KQXZB-MHTWA"


def record(node: str, claim: int = 0, **fields: object) -> EpisodeRecord:
    return EpisodeRecord(episode=ID, code=CODE, node=node, claim=claim, **fields)  # type: ignore[arg-type]


class Nodes:
    """Directories of several nodes."""

    def __init__(self, count: int = 2, seed: int = 0, quality: Quality | None = None) -> None:
        self.nats = SimulatedNats(random.Random(seed), quality)
        self.buses = [self.nats.bus(str(number)) for number in range(count)]
        self.directories = [Directory(bus) for bus in self.buses]

    async def watch(self) -> None:
        for bus, directory in zip(self.buses, self.directories, strict=True):
            await bus.watch(Bucket.EPISODES, directory.changed)

    @property
    def stored(self) -> list[EpisodeRecord]:
        values = self.nats.storage.values(Bucket.EPISODES).values()
        return [EpisodeRecord.model_validate_json(value) for value in values]


@virtual
async def test_all_nodes_know_a_new_episode_by_code_and_id() -> None:
    nodes = Nodes()
    one, two = nodes.directories
    await nodes.watch()
    await one.add(record("a", owner="ada", reserved=True))
    assert one.find(ID) is not None, "the node itself knows it at once"
    await asyncio.sleep(1)
    for name in (ID, CODE, CODE.lower(), "kqxzbmhtwa"):
        found = two.find(name)
        assert found == record("a", owner="ada", reserved=True)
    assert [*two] == [*one]
    assert (len(one), len(two)) == (1, 1)
    assert two.find("KQXZB-MHTWB") is None
    with pytest.raises(ConflictError):
        await two.add(record("b"))


@virtual
async def test_latest_claim_wins_in_any_order() -> None:
    nodes = Nodes()
    one, two = nodes.directories
    await nodes.watch()
    await one.add(record("a"))
    assert await two.replace(record("b", claim=9))
    assert not await one.replace(record("a", claim=5)), "its copy may still be behind"
    assert one.find(CODE) == record("b", claim=9)
    assert await one.replace(record("a", claim=12))
    assert not await two.replace(record("b", claim=9, ended=True))
    assert nodes.stored == [record("a", claim=12)]


@pytest.mark.parametrize("late", [False, True])
@virtual
async def test_episode_that_has_ended_does_not_continue_without_a_claim(late: bool) -> None:
    nodes = Nodes()
    one, two = nodes.directories
    if not late:
        await nodes.watch()
    await one.add(record("a"))
    two.changed(record("a").key, Entry(record("a").model_dump_json().encode(), 1))
    await one.replace(record("a", ended=True))
    await asyncio.sleep(1)
    assert not await two.replace(record("")), "its copy may still be behind"
    assert two.find(CODE) == record("a", ended=True)
    assert nodes.stored == [record("a", ended=True)]


@pytest.mark.slow
def test_concurrent_replacements_leave_the_highest_claim() -> None:
    for seed in range(60):
        loop = SimulatedLoop()
        loop.run_until_complete(replace_concurrently(seed))
        loop.close()
        assert not loop.faults


async def replace_concurrently(seed: int) -> None:
    quality = Quality(jitter=0.05, repeated=0.2, late=0.1, late_seconds=1.0)
    nodes = Nodes(4, seed, quality)
    nodes.nats.storage.stale = 0.3
    await nodes.watch()
    await nodes.directories[0].add(record("0"))
    claims = random.Random(seed).sample(range(1, 100), 12)
    await asyncio.gather(
        *(
            nodes.directories[number % 4].replace(record(str(number % 4), claim))
            for number, claim in enumerate(claims)
        )
    )
    await asyncio.sleep(10)
    last = record(str(claims.index(max(claims)) % 4), max(claims))
    assert nodes.stored == [last]
    assert [directory.find(CODE) for directory in nodes.directories] == [last] * 4


@virtual
async def test_removed_episode_is_forgotten_by_all() -> None:
    nodes = Nodes()
    one, two = nodes.directories
    await nodes.watch()
    await one.add(record("a"))
    await asyncio.sleep(1)
    await two.remove(record("a"))
    assert two.find(ID) is None
    await asyncio.sleep(1)
    assert one.find(ID) is None
    assert not len(one)
    two.changed("UNKNOWN", None)


@virtual
async def test_overtaken_and_invalid_changes_are_ignored() -> None:
    (directory,) = Nodes(1).directories
    key = record("a").key

    def claimed(node: str, claim: int) -> EpisodeRecord:
        return record(node).model_copy(update={"claim": claim})

    def change(node: str, claim: int, revision: int) -> None:
        value = claimed(node, claim).model_dump_json().encode()
        directory.changed(key, Entry(value, revision))

    change("b", 5, 9)
    change("a", 4, 10)
    assert directory.find(CODE) == claimed("b", 5)
    # An operator has deleted the bucket, so its revisions begin again.
    change("c", 6, 1)
    assert directory.find(CODE) == claimed("c", 6)
    with capture_logs() as logs:
        directory.changed(key, Entry(b"{", 6))
    assert [line["log_level"] for line in logs] == ["error"]
    assert directory.find(CODE) == claimed("c", 6)


@virtual
async def test_code_is_looked_up_if_the_copy_is_behind() -> None:
    nodes = Nodes()
    one, two = nodes.directories
    await one.add(record("a"))
    for other in ("", "é", "A.B", "*", ">", "1234", "ABCDEFGHJK"):
        await two.look(other)
    assert two.find(CODE) is None
    await two.look(CODE.lower())
    assert two.find(CODE) == record("a")
    nodes.buses[1].cut()
    with pytest.raises(UnavailableError):
        await two.look(CODE)


@virtual
async def test_participants_are_sent_to_the_node_of_the_episode() -> None:
    (directory,) = Nodes(1).directories
    members = Members(NodeReport(name="a", url="ws://a"), 0.0)
    members.heard(NodeReport(name="b", url="ws://b"), 1)
    slot = ClusterSlot(directory=directory, members=members)
    assert not slot.owns(ID)
    slot.check_here(CODE, CODE, 10)
    ClusterSlot().check_here(CODE, CODE, 10)

    async def set_record(**fields: object) -> None:
        await directory.replace(record(**fields))  # type: ignore[arg-type]

    await set_record(node="b")
    for name in (CODE, ID):
        with pytest.raises(ElsewhereError) as elsewhere:
            slot.check_here(name, CODE, 10)
        assert elsewhere.value.url == "ws://b"
    for node in ("", "c", "a"):
        await set_record(node=node, claim=1)
        with pytest.raises(ProtocolError) as handover:
            slot.check_here(CODE, CODE, 10)
        assert handover.value.code == "server/handover"
    await set_record(node="a", claim=1, ended=True)
    slot.check_here(CODE, CODE, 10)
