"""Nodes that were suspended, as an operating system or a virtual machine does it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from robotouille.replay.recorder import Recorder
from robotouille_client import connect
from robotouille_server.cluster.bus import Append, BusError, Stored, UnavailableError
from robotouille_server.cluster.episodes.journal import (
    LATE_SECONDS,
    JournalKeeper,
    ReplicatedJournal,
)
from robotouille_server.cluster.members import LEASE_SECONDS
from robotouille_server.cluster.node import LOOK_SECONDS
from robotouille_server.rooms.participants.seat_limits import RoundTrips
from robotouille_server.rooms.publishing.publisher import WAITING_SECONDS, SpectatorRosters
from robotouille_server.rooms.recording.write_ahead import CommitGate
from robotouille_server.runtime.timer_queue import TimerQueue
from tests.support.clusters import cluster_of
from tests.support.virtual_time import virtual

TASK = "training/03_multi_agent"
SUSPENDED, STEPS = 60.0, 10


@virtual
async def test_a_game_goes_on_at_once_on_a_node_that_was_suspended_before(tmp_path: Path) -> None:
    async with cluster_of(tmp_path) as nodes:
        async with (
            connect(nodes[0].url, name="ada") as ada,
            connect(nodes[0].url, name="bob") as bob,
        ):
            created = await ada.create(TASK, seats=2, clock="realtime", step_rate=10)
            games = await ada.join(created.code), await bob.join(created.code)
            owner = nodes.owner(created.episode)
            for node in nodes.others(owner):
                node.server.lobby._timers.lost += SUSPENDED
            while games[0].step < STEPS:
                await games[0].next_event()
            await owner.kill()
            begun = asyncio.get_running_loop().time()
            while games[0].step < 2 * STEPS:
                await games[0].next_event()
            assert asyncio.get_running_loop().time() - begun < SUSPENDED / 2


@virtual
async def test_a_client_soon_leaves_a_node_that_has_fallen_silent(tmp_path: Path) -> None:
    async with cluster_of(tmp_path) as nodes, connect(nodes[0].url, name="ada") as ada:
        game = await ada.join((await ada.create(TASK, seats=2)).code)
        owner = nodes.owner(game.episode)
        (member,) = owner.server.lobby.rooms[game.episode].members
        assert member.peer is not None
        silent = ada._socket
        begun = asyncio.get_running_loop().time()
        member.peer.socket.pause_reading("suspended")
        while ada._socket is silent or not ada.connected.is_set():
            await asyncio.sleep(0.1)
        assert asyncio.get_running_loop().time() - begun < 10


class Keeper:
    """Node whose appends the test answers."""

    name = "node"

    def __init__(self) -> None:
        self.lease_certain = True
        self.certain_since = 0.0
        self.bus = self
        self.appends: list[tuple[Append, Callable[[int | BusError], None]]] = []

    def append(self, message: Append, done: Callable[[int | BusError], None]) -> None:
        self.appends.append((message, done))

    async def last(self, subject: str) -> Stored | None:
        raise AssertionError(subject)

    def released(self, journal: ReplicatedJournal) -> None:
        pass

    def begun(self, journal: ReplicatedJournal) -> None:
        pass

    def written(self, journal: ReplicatedJournal, seconds: float) -> None:
        pass


def journal_of(keeper: Keeper) -> ReplicatedJournal:
    recorder = cast("Recorder", None)
    return ReplicatedJournal(
        cast("JournalKeeper", keeper), "episode", "file", recorder, begin=b"step"
    )


@virtual
@pytest.mark.parametrize(("seconds", "publishes"), [(1.0, True), (SUSPENDED, False)])
async def test_an_answer_from_before_a_suspension_publishes_nothing(
    seconds: float, publishes: bool
) -> None:
    keeper = Keeper()
    journal = journal_of(keeper)
    changes: list[bool] = []
    journal.listen(lambda: changes.append(journal.settled))
    journal.write()
    await asyncio.sleep(seconds)
    (_, done), *_ = keeper.appends
    done(1)
    assert changes == ([True] if publishes else [])
    assert journal.settled is publishes
    if not publishes:
        again, done = keeper.appends[1]
        assert (again.data, again.expected) == (b"", 1)
        done(2)
        assert changes == [True]


@virtual
@pytest.mark.parametrize("answered", [True, False])
async def test_a_node_that_continues_announces_no_failure_before_it_has_an_answer(
    answered: bool,
) -> None:
    keeper = Keeper()
    journal = journal_of(keeper)
    changes: list[str] = []
    journal.listen(lambda: changes.append(journal.problem))
    journal.write()
    await asyncio.sleep(SUSPENDED)
    if answered:
        keeper.appends[0][1](UnavailableError("NATS does not answer"))
    journal.look(asyncio.get_running_loop().time())
    await look(journal, LEASE_SECONDS - 0.2)
    assert changes == []
    await look(journal, 0.4)
    assert len(changes) == 1


@virtual
async def test_a_busy_node_does_not_take_its_own_delay_for_a_failure_of_nats() -> None:
    keeper = Keeper()
    journal = journal_of(keeper)
    changes: list[str] = []
    journal.listen(lambda: changes.append(journal.problem))
    journal.write()
    await asyncio.sleep(1)
    journal.look(asyncio.get_running_loop().time())
    assert changes == []
    await look(journal, 2 * LATE_SECONDS)
    assert len(changes) == 1


@virtual
async def test_a_renewed_lease_says_nothing_about_episodes_of_the_time_before() -> None:
    keeper, loop = Keeper(), asyncio.get_running_loop()
    journal = journal_of(keeper)
    journal.write()
    keeper.appends[0][1](1)
    assert journal.check_ownership()
    await asyncio.sleep(SUSPENDED)
    keeper.certain_since = loop.time()
    assert not journal.check_ownership()
    assert not journal.check_ownership(), "one write is enough"
    again, done = keeper.appends[1]
    assert (again.data, again.expected) == (b"", 1)
    done(2)
    assert journal.check_ownership()
    assert len(keeper.appends) == 2


@virtual
async def test_nobody_waits_for_the_owner_of_an_ended_episode() -> None:
    keeper = Keeper()
    journal = ReplicatedJournal(
        cast("JournalKeeper", keeper), "episode", "file", cast("Recorder", None)
    )
    journal.release()
    keeper.lease_certain = False
    assert journal.check_ownership()


@virtual
@pytest.mark.parametrize("cause", ["slow player", "round trips"])
async def test_a_roster_without_an_event_waits_until_the_node_knows_that_it_owns_the_episode(
    cause: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with cluster_of(tmp_path) as nodes:
        async with (
            connect(nodes[0].url, name="ada") as ada,
            connect(nodes[0].url, name="bob") as bob,
        ):
            created = await ada.create(TASK, seats=2, clock="turn", move_budget=0)
            await ada.join(created.code)
            await bob.join(created.code)
            owner = nodes.owner(created.episode)
            room = owner.server.lobby.rooms[created.episode]
            while not room.episode.running:
                await asyncio.sleep(0.1)
            before = room.broadcaster._last_roster
            owner.bus.cut()
            owner.cluster.node.members._renewed -= SUSPENDED
            if cause == "round trips":
                await asyncio.sleep(0.1)
                monkeypatch.setattr(RoundTrips, "measure", lambda *_: (True, []))
                room.driver.measure_round_trips()
            else:
                await asyncio.sleep(WAITING_SECONDS + 0.1)
            assert room.broadcaster._last_roster is before


async def look(journal: ReplicatedJournal, seconds: float) -> None:
    """Look at a journal for a while, as a node does."""
    loop = asyncio.get_running_loop()
    end = loop.time() + seconds
    while loop.time() < end:
        await asyncio.sleep(LOOK_SECONDS)
        journal.look(loop.time())


class OwnershipLog:
    """Recording that is written at once, but whose owner may have changed."""

    waiting, problem = 0, ""

    def __init__(self, owned: bool) -> None:
        self.owned = owned

    def add(self, events: object) -> None:
        raise AssertionError(events)

    def write(self) -> bool:
        return True

    def check_ownership(self) -> bool:
        return self.owned


@virtual
@pytest.mark.parametrize("owned", [True, False])
async def test_a_roster_waits_until_the_node_knows_that_it_owns_the_episode(owned: bool) -> None:
    gate, rosters = CommitGate(OwnershipLog(owned)), list[str]()
    spectators = SpectatorRosters(TimerQueue(), gate, lambda: rosters.append("roster"))
    spectators.changed()
    await asyncio.sleep(1)
    assert rosters == (["roster"] if owned else [])
    gate.release()
    assert rosters == ["roster"]
