"""Journals on a NATS that delays, loses and repeats messages, against a naive reference."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Coroutine, Iterable
from itertools import count
from typing import Any, cast

import pytest
from structlog.testing import capture_logs

from robotouille.replay.recorder import Recorder
from robotouille_server.cluster.bus import (
    Append,
    BusError,
    ConflictError,
    Stored,
    UnavailableError,
)
from robotouille_server.cluster.episodes import journal as module
from robotouille_server.cluster.episodes.journal import (
    LATE_SECONDS,
    MAX_PIECE,
    JournalEnd,
    ReplicatedJournal,
    assembled,
)
from tests.programs.simulation.loop import SimulatedLoop
from tests.support.buses import Quality, SimulatedBus, SimulatedNats
from tests.support.samples import quick_sample

EPISODE = "e"
HEADER = b"header\n"
PIECE = 40
"""Size of a piece in the property tests, so that most writes have several."""
BLOCK = 10


class Lines:
    """Recorder whose events are their own encoding. Every frame ends with a newline."""

    frames = 0

    def record(self, events: Iterable[Any]) -> bytes:
        return b"".join(events)


class Keeper:
    """Node with journals that it looks at, as `ClusterNode` does."""

    def __init__(self, nats: SimulatedNats, name: str) -> None:
        self.name = name
        self.bus: SimulatedBus = nats.bus(name)
        self.lease_certain = True
        self.certain_since = 0.0
        self.journals: list[ReplicatedJournal] = []
        self.lost: list[ReplicatedJournal] = []
        self.finished: list[bool] = []
        self._looking = nats.loop.create_task(self._look())

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(0.1)
            for journal in list(self.journals):
                journal.look(asyncio.get_running_loop().time())

    def begun(self, journal: ReplicatedJournal) -> None:
        self.journals.append(journal)

    def written(self, journal: ReplicatedJournal, seconds: float) -> None:
        assert seconds >= 0

    def fenced(self, journal: ReplicatedJournal) -> None:
        self.lost.append(journal)
        journal.release()

    def finish(self, journal: ReplicatedJournal, *, kept: bool) -> asyncio.Future[str]:
        self.finished.append(kept)
        return asyncio.get_running_loop().create_future()

    def released(self, journal: ReplicatedJournal) -> None:
        self.journals.remove(journal)

    def stop(self) -> None:
        self._looking.cancel()


class Writer:
    """Naive reference of one writer: the lines that it has added, and how many are written."""

    def __init__(self, keeper: Keeper, number: int, end: JournalEnd | None = None) -> None:
        self.keeper, self.number = keeper, number
        self.lines: list[bytes] = []
        self.acknowledged = 0
        begin = b"" if end is not None else HEADER
        recorder = cast("Recorder", Lines())
        self.journal = ReplicatedJournal(
            keeper, EPISODE, f"{EPISODE}.rbt.part", recorder, begin=begin, end=end
        )
        self.journal.listen(self._changed)
        self.journal.write()

    @property
    def fenced(self) -> bool:
        return self.journal in self.keeper.lost

    def add(self, size: int = 0) -> None:
        line = f"{self.number}/{len(self.lines)} {'x' * size}\n".encode()
        self.lines.append(line)
        self.journal.add([line])  # type: ignore[list-item]
        self._changed()

    def _changed(self) -> None:
        if self.journal.write():
            assert not self.fenced, "a fenced writer reports a write as written"
            self.acknowledged = len(self.lines)


def simulate(course: Coroutine[Any, Any, None]) -> None:
    """Run a course without real time, and fail if a callback has raised."""
    loop = SimulatedLoop()
    with capture_logs():
        try:
            loop.run_until_complete(course)
        finally:
            for task in loop.living_tasks():
                task.cancel()
            loop.run_until_complete(asyncio.sleep(0))
            loop.close()
    assert not loop.faults


def simulated(test: Callable[[], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    """Run a test without real time."""

    def running() -> None:
        simulate(test())

    return running


async def take_over(nats: SimulatedNats, keeper: Keeper, number: int, *, cut: bool) -> Writer:
    """Continue the journal as another node does; let the first write cut the torn end if `cut`."""
    for attempt in range(1000):
        try:
            stored = await keeper.bus.read(EPISODE)
            content = assembled(stored)
            size = content.rfind(b"\n") + 1
            if not size:  # Nodes know an episode only after its first write.
                await asyncio.sleep(0.2)
                continue
            keep = size if size < len(content) else None
            if cut and keep is not None:
                return Writer(keeper, number, JournalEnd(stored[-1].sequence, size, cut=True))
            name = f"{EPISODE}.{keeper.name}.claim.{number}.{attempt}"
            claim = Append(EPISODE, b"", stored[-1].sequence, name, keep)
            return Writer(keeper, number, JournalEnd(await appended(keeper.bus, claim), size))
        except BusError:
            await asyncio.sleep(0.3)
    raise AssertionError("the journal cannot be taken over")


async def appended(bus: SimulatedBus, message: Append) -> int:
    result: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    def done(answer: int | BusError) -> None:
        if isinstance(answer, int):
            result.set_result(answer)
        else:
            result.set_exception(answer)

    bus.append(message, done)
    return await result


class Course:
    """Course of a seed: two nodes take one journal over from each other, or from themselves."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        often = self.chance.choice((0.0, 0.05, 0.3))
        quality = Quality(jitter=self.chance.choice((0.0, 0.01, 0.5)))
        quality.lost, quality.repeated, quality.late = (self.chance.random() * often for _ in "abc")
        self.nats = SimulatedNats(self.chance, quality)
        self.keepers = [Keeper(self.nats, name) for name in ("a", "b")]
        self.writers = [Writer(self.keepers[0], 0)]

    async def run(self) -> None:
        takeovers: list[asyncio.Task[None]] = []
        for number in range(1, 1 + self.chance.randint(1, 3)):
            await self._write(self.chance.randint(1, 30))
            takeovers.append(asyncio.create_task(self._take_over(number)))
        await self._write(20)
        self._heal()
        self.nats.quality = Quality()
        await asyncio.gather(*takeovers)
        # A writer that has lost the journal learns it here at the latest.
        for writer in self.writers:
            writer.add()
        await asyncio.sleep(10)
        self._check()
        for keeper in self.keepers:
            keeper.stop()

    async def _write(self, times: int) -> None:
        for _ in range(times):
            await asyncio.sleep(self.chance.expovariate(5))
            self.chance.choice(self.writers).add(self.chance.choice((0, 0, 5, 100, 300)))
            if self.chance.random() < 0.2:
                self._trouble()

    def _trouble(self) -> None:
        self._heal()
        what = self.chance.randrange(4)
        if what == 0:
            self.nats.lose_quorum()
        elif what < 3:
            self.chance.choice(self.keepers).bus.cut(answers_only=what == 1)

    def _heal(self) -> None:
        for keeper in self.keepers:
            keeper.bus.heal()
        if not self.nats.quorum:
            self.nats.regain_quorum()

    async def _take_over(self, number: int) -> None:
        keeper, cut = self.chance.choice(self.keepers), self.chance.random() < 0.5
        self.writers.append(await take_over(self.nats, keeper, number, cut=cut))

    def _check(self) -> None:
        stored = self.nats.storage.messages(EPISODE)
        left = assembled(stored).splitlines(keepends=True)
        assert left.pop(0) == HEADER
        numbers = [int(line.partition(b"/")[0]) for line in left]
        for writer in self.writers:
            kept = numbers.count(writer.number)
            own = [line for line in left if line.startswith(b"%d/" % writer.number)]
            assert own == writer.lines[:kept], "lines are missing, torn or in another order"
            assert kept >= writer.acknowledged, "a write that was reported as written is lost"
            assert writer.fenced or writer.journal.settled, "the journal does not settle"
            assert writer.fenced or kept == len(writer.lines)
        # All lines of a writer are next to each other: nobody writes after another one.
        assert len({*numbers}) == sum(a != b for a, b in zip([-1, *numbers], numbers, strict=False))
        going_on = [writer for writer in self.writers if not writer.fenced]
        assert len(going_on) == 1, "not exactly one writer goes on"


@pytest.mark.parametrize("start", quick_sample(range(0, 1000, BLOCK), 4))
def test_journal_agrees_with_the_reference(start: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_PIECE", PIECE)
    for seed in range(start, start + BLOCK):
        simulate(course(seed))


async def course(seed: int) -> None:
    try:
        await Course(seed).run()
    except AssertionError as error:
        raise AssertionError(f"seed {seed}: {error}") from error


@pytest.mark.parametrize("start", quick_sample(range(0, 300, BLOCK), 2))
def test_tail_completes_what_another_node_has_read(
    start: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_PIECE", PIECE)
    monkeypatch.setattr(module, "MAX_TAIL", 1_000_000)
    for seed in range(start, start + BLOCK):
        simulate(tail_course(seed))


async def tail_course(seed: int) -> None:
    """Read a journal at some time while it is written, and complete it from the tail later."""
    chance = random.Random(seed)
    quality = Quality(jitter=chance.choice((0.0, 0.01, 0.5)), lost=chance.choice((0.0, 0.1)))
    nats = SimulatedNats(chance, quality)
    keeper = Keeper(nats, "a")
    writer = Writer(keeper, 0)
    journal = writer.journal

    async def write(times: int) -> None:
        for _ in range(times):
            writer.add(chance.choice((0, 5, 100)))
            await asyncio.sleep(chance.expovariate(20))

    await write(chance.randint(0, 10))
    journal.keep_tail()
    await write(chance.randint(0, 10))
    known = assembled(nats.storage.messages(EPISODE))
    await write(chance.randint(0, 10))
    while (tail := journal.tail) is None:
        await asyncio.sleep(0.1)
    whole = assembled(nats.storage.messages(EPISODE))
    assert known[: tail.start] + tail.data == whole, f"seed {seed}"
    assert tail.data.startswith(known[tail.start :]), f"seed {seed}"
    keeper.stop()


@simulated
async def test_a_journal_has_no_tail_while_a_write_is_under_way_or_if_it_is_long() -> None:
    nats = SimulatedNats(random.Random(1))
    keeper = Keeper(nats, "a")
    writer = Writer(keeper, 0)
    assert writer.journal.tail is None
    await asyncio.sleep(1)
    writer.journal.keep_tail()
    assert writer.journal.tail is not None
    writer.add()
    assert writer.journal.tail is None
    await asyncio.sleep(1)
    assert writer.journal.tail is not None
    writer.add(module.MAX_TAIL)
    await asyncio.sleep(1)
    assert writer.journal.settled
    assert writer.journal.tail is None
    keeper.stop()


# Faults that the reference finds


def ignore_conflicts(patch: pytest.MonkeyPatch) -> None:
    """Take a refused write for a written one."""
    answered = ReplicatedJournal._answered

    def careless(journal: ReplicatedJournal, write: Any, result: int | BusError) -> None:
        number = write.message.expected + 1
        answered(journal, write, number if isinstance(result, ConflictError) else result)

    patch.setattr(ReplicatedJournal, "_answered", careless)


def count_writes_of_each_journal(patch: pytest.MonkeyPatch) -> None:
    """Name writes alike if a node has an episode for the second time."""
    begin = ReplicatedJournal.__init__

    def restart(journal: ReplicatedJournal, *values: Any, **options: Any) -> None:
        patch.setattr(module, "_numbers", count(1))
        begin(journal, *values, **options)

    patch.setattr(ReplicatedJournal, "__init__", restart)


def forget_torn_ends(patch: pytest.MonkeyPatch) -> None:
    """Leave the pieces of an incomplete write in the journal."""

    def careless(messages: Iterable[Stored]) -> bytes:
        return b"".join(message.data for message in messages)

    patch.setitem(globals(), "assembled", careless)


def publish_before_the_last_piece(patch: pytest.MonkeyPatch) -> None:
    """Report a write as written when its first piece is."""
    write = ReplicatedJournal.write
    patch.setattr(
        ReplicatedJournal, "write", lambda journal: write(journal) or journal.waiting < 50
    )


@pytest.mark.parametrize(
    "plant",
    [
        ignore_conflicts,
        count_writes_of_each_journal,
        forget_torn_ends,
        publish_before_the_last_piece,
    ],
)
def test_fault_of_a_journal_is_found(
    plant: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_PIECE", PIECE)
    plant(monkeypatch)
    with pytest.raises(AssertionError, match="seed"):
        for seed in range(30):
            simulate(course(seed))


# Single cases


class Pair:
    """Two nodes; the first one writes."""

    def __init__(self) -> None:
        self.nats = SimulatedNats()
        self.one, self.two = (Keeper(self.nats, name) for name in ("a", "b"))
        self.writer = Writer(self.one, 0)

    @property
    def content(self) -> bytes:
        return assembled(self.nats.storage.messages(EPISODE))


@simulated
async def test_torn_end_is_cut_off_when_another_node_continues() -> None:
    for cut in (False, True):
        pair = Pair()
        await pair.writer.journal.stored()
        pair.writer.add(10)
        await pair.writer.journal.stored()
        whole = pair.content
        # The node is cut off when a quorum has the first piece of a large write.
        pair.nats.storage.on_stored = lambda *_, pair=pair: pair.one.bus.cut()
        pair.writer.add(3 * MAX_PIECE)
        await asyncio.sleep(5)
        pair.nats.storage.on_stored = None
        assert len(pair.content) == len(whole) + MAX_PIECE
        other = await take_over(pair.nats, pair.two, 1, cut=cut)
        other.add(2 * MAX_PIECE)
        await other.journal.stored()
        assert pair.content == whole + other.lines[0]
        assert other.journal.size == len(pair.content)
        other.add()
        await other.journal.stored()
        assert pair.content == whole + b"".join(other.lines)
        pair.one.bus.heal()
        await asyncio.sleep(5)
        assert pair.writer.fenced
        assert pair.writer.acknowledged == 1


@simulated
async def test_node_that_takes_an_episode_back_loses_nothing() -> None:
    pair = Pair()
    pair.writer.add()
    await pair.writer.journal.stored()
    for number in range(1, 6):
        keeper = pair.two if number % 2 else pair.one
        writer = await take_over(pair.nats, keeper, number, cut=False)
        writer.add()
        await writer.journal.stored()
        assert pair.content.endswith(writer.lines[0])
    assert len(pair.content.splitlines()) == 7


@simulated
async def test_write_that_was_stored_without_an_answer_is_recognized() -> None:
    """NATS recognizes ids for two minutes only; after that, the journal reads its last message."""
    pair = Pair()
    await pair.writer.journal.stored()
    pair.one.bus.cut(answers_only=True)
    pair.writer.add()
    await asyncio.sleep(130)
    assert pair.writer.acknowledged == 0
    assert pair.writer.journal.problem
    pair.one.bus.heal()
    await pair.writer.journal.stored()
    assert (pair.writer.acknowledged, pair.writer.fenced) == (1, False)
    assert not pair.writer.journal.problem
    assert len(pair.content.splitlines()) == 2


@simulated
async def test_late_write_is_reported_once_and_works_again() -> None:
    pair = Pair()
    await pair.writer.journal.stored()
    changes: list[str] = []
    pair.writer.journal.listen(lambda: changes.append(pair.writer.journal.problem))
    pair.one.bus.cut()
    pair.writer.add()
    await asyncio.sleep(LATE_SECONDS - 0.1)
    assert not changes
    await asyncio.sleep(0.3)
    assert changes == [pair.writer.journal.problem]
    assert "quorum" in changes[0]
    with pytest.raises(UnavailableError):
        await pair.writer.journal.stored(1.0)
    pair.one.bus.heal()
    await pair.writer.journal.stored()
    assert changes[1:] == [""]


@simulated
async def test_idle_node_with_an_uncertain_lease_finds_out_whether_it_has_the_episode() -> None:
    pair = Pair()
    journal = pair.writer.journal
    await journal.stored()
    assert journal.check_ownership()
    pair.one.lease_certain = False
    assert not journal.check_ownership()
    assert not journal.check_ownership(), "one write is enough"
    await asyncio.sleep(0.5)
    assert journal.settled
    before = len(pair.nats.storage.messages(EPISODE))
    assert not journal.check_ownership(), "the answer was about the past"
    await asyncio.sleep(0.5)
    assert len(pair.nats.storage.messages(EPISODE)) == before + 1
    await take_over(pair.nats, pair.two, 1, cut=False)
    assert not journal.check_ownership()
    await asyncio.sleep(0.5)
    assert pair.writer.fenced
    assert not journal.write()


@simulated
async def test_released_journal_writes_nothing_more() -> None:
    pair = Pair()
    await pair.writer.journal.stored()
    content = pair.content
    waiting = asyncio.create_task(pair.writer.journal.stored())
    pair.writer.journal.finish(kept=False)
    await waiting
    pair.writer.add()
    await asyncio.sleep(5)
    assert pair.content == content
    assert pair.one.finished == [False]


@simulated
async def test_a_write_that_nats_has_stored_twice_counts_once() -> None:
    pair = Pair()
    pair.writer.add()
    await pair.writer.journal.stored()
    content, storage = pair.content, pair.nats.storage
    last = storage.messages(EPISODE)[-1]
    storage.apply("a", Append(EPISODE, last.data, last.sequence, last.id))
    assert pair.content == content
    pair.writer.add()
    await pair.writer.journal.stored()
    assert not pair.writer.fenced
    assert pair.content == content + pair.writer.lines[-1]
