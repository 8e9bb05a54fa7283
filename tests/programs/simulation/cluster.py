"""Simulation of a cluster: real nodes and rooms on a simulated NATS, with faults.

    python -m tests.programs.simulation.cluster --seeds 0:1000 --jobs 2
    python -m tests.programs.simulation.cluster --seed 1234 --trace

A seed determines everything. Three machines run `ClusterNode` with a `Lobby`; players act in two
episodes and go from node to node. With every second seed, one of them floods all nodes until the
faults stop. Nodes are killed, stopped (and continue later as if nothing had happened), cut off from
NATS or only from its news, and asked to leave. NATS loses its quorum, or all messages are slow,
lost or repeated for a while. An operator deletes a bucket; then no node stops until the bucket is
filled again, because what it knows may be known to it alone. All nodes are killed at once; after a
loss of power, the last message of a journal also appears late, or disappears.

Invariants:

* Everything that a node publishes is in the journal then, and at the end.
* No two nodes publish different contents of a step. No step is lost after it was published.
* A node that answers without a write owns the episode at that moment.
* Nodes claim only the episodes of a node that was silent for the time of the lease, or that leaves.
* When the faults stop, exactly one node continues each episode, each episode ends, and a deleted
  bucket has been filled again.
* Each recording is stored once, agrees with the journal, and verifies. Nothing else is left.
* The nodes log no unexpected error.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import os
import random
import sys
from collections import Counter
from collections.abc import Callable
from contextvars import copy_context
from unittest.mock import patch

from robotouille_server.cluster import node
from robotouille_server.cluster.bus import Bucket, Stored
from robotouille_server.cluster.episodes.directory import EpisodeRecord
from robotouille_server.cluster.episodes.journal import ReplicatedJournal
from tests.programs.simulation.cluster_games import Game
from tests.programs.simulation.cluster_nodes import NodeMachine
from tests.programs.simulation.cluster_oracle import ClusterOracle
from tests.programs.simulation.journal import Journal
from tests.programs.simulation.logs import watch_logs
from tests.programs.simulation.loop import EPOCH, Process, SimulatedLoop
from tests.programs.simulation.runs import run_many
from tests.programs.simulation.simulation import MAX_FAULTS, Report
from tests.support.buses import Quality, SimulatedNats

__all__ = ["ClusterSimulation", "run_block", "run_cluster_seed"]

PROGRAM = "tests.programs.simulation.cluster"
NODES = 3
GAMES = 2
COMMIT_SECONDS = 0.02
"""Longest time between the check of a message and its storage."""
SETTLE_SECONDS = 20.0
"""Seconds after the last fault in which one node must have each episode."""
PATIENCE = 240.0
"""Seconds after the last fault in which all episodes must end."""
LINGER_SECONDS = 140.0
"""Seconds after the end of all episodes after which the cluster must have forgotten them."""
LINGERING = 10
FAULTS = (
    "kill",
    "stop",
    "cut",
    "deafen",
    "lose_quorum",
    "spoil",
    "leave",
    "delete_bucket",
    "kill_all",
    "lose_power",
)


class ClusterSimulation:
    """A simulated cluster made from a seed."""

    def __init__(self, seed: int, *, trace: bool = False) -> None:
        self.seed = seed
        self.context = copy_context()
        self.loop = SimulatedLoop()
        self.ending = self.power_fails = False
        self.troubled = True
        self.faults: list[str] = []
        self.processes: list[Process] = []
        self.done: Counter[str] = Counter()
        self.journal = Journal(self.loop.time, show=trace)
        self.trace = self.journal.note
        self.chance = random.Random(seed)
        self.oracle = ClusterOracle(self.fail, self.loop.time)
        self.nats = SimulatedNats(random.Random(f"{seed}/nats"), loop=self.loop)
        self.nats.commit_seconds = COMMIT_SECONDS
        storage = self.nats.storage
        storage.on_stored, storage.on_purged = self._stored, self.oracle.purged
        storage.on_set.append(self.oracle.set)
        self.machines = [NodeMachine(self, number) for number in range(NODES)]
        self.games = [Game(self, f"g{number}") for number in range(GAMES)]

    def _stored(self, writer: str, journal: str, message: Stored) -> None:
        self.trace("stored", writer, journal, message.sequence, message.keep, len(message.data))
        fails = self.power_fails and message.data and ".claim." not in message.id
        if fails and not self._bereft and len(self.nats.storage.messages(journal)) > 1:
            self.power_fails = False
            self._kill_all()
            if self.chance.random() < 0.5:
                self._hide(writer, journal, message)
                return
            self._later(lambda: self._lose(journal, message))
        self.oracle.stored(writer, journal, message)

    def _hide(self, writer: str, journal: str, message: Stored) -> None:
        """Let a message appear later."""
        storage = self.nats.storage
        bring_back = storage.remove_message(journal, message.sequence)

        def appear() -> None:
            bring_back()
            if storage.messages(journal)[-1:] == [message]:
                self.oracle.stored(writer, journal, message)

        self._later(appear)

    def _lose(self, journal: str, message: Stored) -> None:
        """Let a message disappear, if a node has read it since."""
        storage = self.nats.storage
        later = [one for one in storage.messages(journal) if one.sequence > message.sequence]
        if any(one.data for one in later):
            storage.remove_message(journal, message.sequence)

    def fail(self, fault: str) -> None:
        """Report a broken invariant."""
        if len(self.faults) < MAX_FAULTS and not self.ending:
            self.faults.append(f"at {self.loop.time() - EPOCH:.3f} s: {fault}")
            self.trace("BROKEN", fault)

    async def _is_ready(self, url: str) -> bool:
        """Answer the question of one node to another, which does not pass through NATS."""
        await asyncio.sleep(0.01)
        return any(machine.url == url and machine.ready for machine in self.machines)

    def _watched_check(self) -> Callable[[ReplicatedJournal], bool]:
        """Return `check_ownership` with a check of its answer."""
        check, answers = ReplicatedJournal.check_ownership, self.oracle.answers

        def watched(journal: ReplicatedJournal) -> bool:
            owned = check(journal)
            if owned and not journal._released:
                answers(journal._keeper.name, journal.episode)
            return owned

        return watched

    # Course of a run

    def run(self) -> Report:
        try:
            watch_logs(self.fail)
            asyncio.set_event_loop(self.loop)
            owns = patch.object(ReplicatedJournal, "check_ownership", self._watched_check())
            with patch.object(node, "is_ready", self._is_ready), owns:
                self.loop.run_until_complete(self._course())
        except Exception as error:
            self.fail(f"{type(error).__name__}: {error}")
        finally:
            asyncio.set_event_loop(None)
        for fault in self.loop.faults:
            self.fail(fault)
        watch_logs(lambda line: None)
        counts = dict(self.oracle.counts + self.done)
        seconds = self.loop.time() - EPOCH
        digest, callbacks = self.journal.digest, self.loop.callbacks
        self._bury()
        return Report(self.seed, self.faults, digest, seconds, callbacks, counts)

    def _bury(self) -> None:
        self.ending = True
        for process in self.processes:
            process.kill()
        with self.loop.muted():
            for process in self.processes:
                process.bury()
            for task in self.loop.living_tasks():
                task.abandon(copy_context())
        self.loop.close()

    async def _course(self) -> None:
        for machine in self.machines:
            machine.boot()
        await asyncio.sleep(1.0)
        games = [asyncio.ensure_future(game.run()) for game in self.games]
        await self._trouble()
        await self._until(self._settled, SETTLE_SECONDS)
        await self._until(self._over, PATIENCE)
        if self.faults:
            return
        await asyncio.gather(*games)
        await self._until(self._stored_all, SETTLE_SECONDS)
        for game in self.games:
            self.oracle.check_file(game.id, self.nats.storage.files)
        # Nodes keep ended episodes for two minutes, so only some seeds wait for that.
        if self.seed % LINGERING == 0:
            await self._until(self._left_nothing, LINGER_SECONDS)

    async def _until(self, missing: Callable[[], str], seconds: float) -> None:
        """Wait until nothing is missing any more."""
        deadline = self.loop.time() + seconds
        while not self.faults and (what := missing()):
            if self.loop.time() > deadline:
                self.fail(f"{seconds:.0f} s later, {what}")
            await asyncio.sleep(0.5)

    def _settled(self) -> str:
        for game in self.games:
            holders = [machine.name for machine in game.holders]
            if not game.id:
                return f"{game.tag} is not open"
            if len(holders) != 1 and not game.over:
                return f"{game.id} is continued by {holders}"
        return "a deleted bucket is not filled again" if self._bereft else ""

    def _over(self) -> str:
        return ", ".join(f"{g.id} has not ended" for g in self.games if not g.over)

    def _stored_all(self) -> str:
        left = [g.id for g in self.games if not self.oracle.truths[g.id].purged]
        return f"{left} are not stored as files" if left else ""

    def _left_nothing(self) -> str:
        storage = self.nats.storage
        records = sorted(storage.values(Bucket.EPISODES))
        rooms = [room.id for m in self.machines if m.lobby for room in m.lobby.rooms.values()]
        left = sorted(storage.journals) + records + rooms
        return f"the cluster still has {left}" if left else ""

    # Faults

    async def _trouble(self) -> None:
        """Cause faults for a while, then repair everything."""
        chance = self.chance
        kinds = chance.sample(FAULTS, chance.randint(1, len(FAULTS)))
        pause, end = chance.uniform(0.5, 3.0), self.loop.time() + chance.uniform(3, 15)
        while not self.faults:
            await asyncio.sleep(chance.expovariate(1 / pause))
            if self.loop.time() > end:
                break
            kind = chance.choice(kinds)
            what = getattr(self, f"_{kind}")()
            self.trace("fault", kind, what)
            self.done[kind] += 1
        self._heal()

    def _heal(self) -> None:
        self.trace("fault", "heal")
        self.troubled = False
        for machine in self.machines:
            machine.bus.heal()
            machine.process.dies_at = None
            if machine.process.suspended:
                machine.process.wake()
        self._regain_quorum()
        self._repair()

    def _later(self, act: Callable[[], object]) -> float:
        """Let a fault end after a duration that is often longer than the lease."""
        seconds = self.chance.choice((0.3, 1.0, 2.5, 4.0, 6.0, 9.0)) * self.chance.uniform(0.8, 1.2)
        self.loop.call_later(seconds, act)
        return seconds

    def _machine(self) -> NodeMachine:
        return self.chance.choice(self.machines)

    @property
    def _bereft(self) -> bool:
        """True while only the nodes know what a deleted bucket had."""
        storage = self.nats.storage
        if len(storage.created()) < len(Bucket):
            return True
        known = {EpisodeRecord.model_validate_json(v).episode
                 for v in storage.values(Bucket.EPISODES).values()}  # fmt: skip
        return any(game.id and not game.over and game.id not in known for game in self.games)

    def _delete_bucket(self) -> str:
        """Let an operator delete a bucket."""
        up = all(machine.ready and machine.process.dies_at is None for machine in self.machines)
        if self._bereft or not up:
            return ""
        bucket = self.chance.choice(list(Bucket))
        self.nats.storage.delete_bucket(bucket)
        return bucket

    def _kill(self) -> str:
        if self._bereft:
            return ""
        process = self._machine().process
        process.dies_at = process.callbacks + self.chance.choice((1, 5, 20, 60))
        return process.name

    def _kill_all(self) -> str:
        if self._bereft:
            return ""
        for machine in self.machines:
            machine.process.kill()
        return ""

    def _lose_power(self) -> str:
        """Kill all nodes when a message is stored that nobody knows to be stored."""
        self.power_fails = True
        return ""

    def _stop(self) -> str:
        machine = self._machine()
        process, bus = machine.process, machine.bus
        if process.suspended or process.dead:
            return ""
        process.suspend()
        seconds = self._later(process.wake)
        # NATS closes the connection of a stopped client, so its watches begin again only later.
        bus.deafen()
        self.loop.call_later(seconds + self.chance.choice((0.0, 0.5, 2.0)), bus.heal)
        return f"{process.name} {seconds:.3f}"

    def _cut(self) -> str:
        machine = self._machine()
        machine.bus.cut(answers_only=self.chance.random() < 0.5)
        return f"{machine.name} {self._later(machine.bus.heal):.3f}"

    def _deafen(self) -> str:
        """Let the server with a node's watches die."""
        machine = self._machine()
        machine.bus.deafen()
        return f"{machine.name} {self._later(machine.bus.heal):.3f}"

    def _lose_quorum(self) -> str:
        self.nats.lose_quorum()
        return f"{self._later(self._regain_quorum):.3f}"

    def _regain_quorum(self) -> None:
        if not self.nats.quorum:
            self.nats.regain_quorum()

    def _spoil(self) -> str:
        rate = self.chance.choice((0.02, 0.1, 0.3))
        self.nats.quality = Quality(0.005, 0.05, rate / 2, rate, rate)
        return f"{rate} {self._later(self._repair):.3f}"

    def _repair(self) -> None:
        self.nats.quality = Quality()

    def _leave(self) -> str:
        if self._bereft:
            return ""
        machine = self._machine()
        return machine.name if machine.leave() else ""


def run_cluster_seed(seed: int, *, trace: bool = False) -> Report:
    """Simulate a seed. The same seed gives the same course in every process."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        return ClusterSimulation(seed, trace=trace).run()
    finally:
        if collecting:
            gc.enable()


def run_block(first: int, last: int) -> list[Report]:
    """Run a range of seeds and return their reports."""
    return [run_cluster_seed(seed) for seed in range(first, last)]


def main() -> int:
    parser = argparse.ArgumentParser(prog=f"python -m {PROGRAM}", description=__doc__)
    parser.add_argument("--seeds", default="0:1000", metavar="FROM:TO", help="seeds to run")
    parser.add_argument("--seed", type=int, help="one seed")
    parser.add_argument("--trace", action="store_true", help="with --seed: print every event")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    options = parser.parse_args()
    if options.seed is not None:
        report = run_cluster_seed(options.seed, trace=options.trace)
        print(
            f"seed {report.seed}: {'ok' if report.ok else 'FAILED'}, digest {report.digest}",
            end="\n    ",
        )
        print(
            "\n".join(f"    {line}" for line in (*map(str, report.counts.items()), *report.faults))
        )
        return 0 if report.ok else 1
    first, _, last = options.seeds.partition(":")
    return run_many(
        int(first), int(last), options.jobs, None, work=run_block, program=PROGRAM
    ).finish()


if __name__ == "__main__":
    sys.exit(main())
