"""One run of a seed's scenario, with all broken invariants."""

from __future__ import annotations

import asyncio
import gc
import random
from collections import Counter
from collections.abc import Callable
from contextvars import copy_context
from dataclasses import dataclass, field

from robotouille_server.conversation import Conversation
from robotouille_server.rooms.episode_driver import EpisodeDriver
from robotouille_server.rooms.lobby import Lobby
from tests.programs.simulation.adversary import Adversary
from tests.programs.simulation.clients import Participant
from tests.programs.simulation.disk import Disk
from tests.programs.simulation.journal import Journal
from tests.programs.simulation.logs import watch_logs
from tests.programs.simulation.loop import EPOCH, Process, SimulatedLoop
from tests.programs.simulation.machine import ServerMachine
from tests.programs.simulation.network import Network
from tests.programs.simulation.oracle import Oracle
from tests.programs.simulation.scenario import EpisodePlan, Scenario, draw

__all__ = ["Report", "Simulation", "run_seed"]

PATIENCE = 900.0
"""Virtual seconds in which all episodes must end once the faults have stopped."""
FORGOTTEN = 800.0
"""Seconds after which a server must have discarded ended episodes and abandoned sessions."""
IN_FLIGHT = "Pipe."
"""Messages in transit belong to the network, not to the server."""

PASSING = (
    "Timeout.",
    "_set_result_unless_cancelled",
    Conversation._hello_timeout.__qualname__,
    Lobby._forget.__qualname__,
    EpisodeDriver._write_again.__qualname__,
)
"""Timers that a server may leave while connections to unresponsive clients still close."""
MAX_FAULTS = 20


@dataclass
class Report:
    """Result of a run; `faults` lists the broken invariants."""

    seed: int
    faults: list[str]
    digest: str
    seconds: float = 0.0
    callbacks: int = 0
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        return not self.faults


class Simulation:
    """A simulated world made from a seed: loop, network, disk, server, participants, adversary."""

    def __init__(
        self,
        seed: int,
        *,
        trace: bool = False,
        draw_scenario: Callable[[random.Random], Scenario] = draw,
    ) -> None:
        self.seed = seed
        self.context = copy_context()
        self.loop = SimulatedLoop()
        self.ending = False
        self.faults: list[str] = []
        self.suspicions: list[str] = []
        self.processes: list[Process] = []
        self.participants: list[Participant] = []
        self.plans: list[EpisodePlan] = []
        self.owners: dict[str, EpisodePlan] = {}
        self.journal = Journal(self.loop.time, show=trace)
        self.trace = self.journal.note
        self.chance = random.Random(seed)
        self.scenario = draw_scenario(self.chance)
        self.oracle = Oracle(self.fail)
        self.network = self._make_network()
        self.disk = self._make_disk()
        self.server = ServerMachine(self, self.scenario.settings)
        self.adversary = Adversary(self, self.scenario, random.Random(f"{seed}/adversary"))

    def _make_network(self) -> Network:
        network = Network(
            self.loop, random.Random(f"{self.seed}/network"), self.scenario.conditions
        )
        network.patient_close = self.scenario.patient_close
        network.trace = self.trace
        return network

    def _make_disk(self) -> Disk:
        disk = Disk(random.Random(f"{self.seed}/disk"))
        disk.on_append = self.oracle.appended
        disk.on_cut = self.oracle.cut
        disk.on_closed = self.oracle.replaced
        disk.on_removed = self.oracle.removed
        return disk

    # Called by the parts

    @property
    def elapsed(self) -> float:
        """Return the seconds since the run started."""
        return self.loop.time() - EPOCH

    def fail(self, fault: str) -> None:
        """Report a broken invariant."""
        if len(self.faults) < MAX_FAULTS:
            self.faults.append(f"at {self.elapsed:.3f} s: {fault}")
            self.trace("BROKEN", fault)

    def suspect(self, what: str) -> None:
        """Report an anomaly that may explain a fault."""
        if len(self.suspicions) < MAX_FAULTS:
            self.suspicions.append(f"at {self.elapsed:.3f} s: {what}")

    # Course of a run

    def run(self) -> Report:
        try:
            watch_logs(self.fail)
            asyncio.set_event_loop(self.loop)
            self.loop.run_until_complete(self.course())
        except Exception as error:
            self.fail(f"{type(error).__name__}: {error}")
        finally:
            asyncio.set_event_loop(None)
        for fault in self.loop.faults:
            self.fail(fault)
        watch_logs(lambda line: None)
        report = Report(
            self.seed,
            self.faults + (self.suspicions if self.faults else []),
            self.journal.digest,
            self.elapsed,
            self.loop.callbacks,
            dict(self.oracle.counts + Counter(self.adversary.done)),
        )
        self._bury()
        return report

    async def course(self) -> None:
        """Play with faults, then without them until all episodes end, and check for leftovers."""
        self.server.boot()
        for draw_plan in self.scenario.plans:
            self.open(draw_plan(self, self.chance))
        await self.adversary.trouble()
        await self.all_over()
        await self.nothing_kept()
        await self.shut_down()

    def open(self, plan: EpisodePlan) -> None:
        """Start the participants of an episode."""
        self.plans.append(plan)
        for enlisted in plan.people:
            participant = Participant(self, plan, enlisted)
            self.participants.append(participant)
            participant.start()

    async def all_over(self) -> None:
        """Wait until all episodes have ended, after the faults have stopped."""
        deadline = self.loop.time() + PATIENCE
        while not self.faults and any(not p.done for p in self.participants):
            if self.loop.time() > deadline:
                waiting = [p.name for p in self.participants if not p.done]
                self.fail(f"not ended: {', '.join(waiting)}; {self._where()}")
                return
            self.compare_server()
            await asyncio.sleep(0.5)
        for participant in self.participants:
            participant.gone()

    def compare_server(self) -> None:
        """Check that the server's states match the recordings."""
        server = self.server.server
        for room in list(server.lobby.rooms.values()) if server is not None else ():
            truth = self.oracle.find(room.id)
            if truth is None or room.problem:
                continue
            if (room.episode.step, room.episode.state.digest) != (
                truth.step,
                truth.digest(truth.step),
            ):
                self.fail(f"the server is at step {room.episode.step} of {room.id}, not recorded")

    def _where(self) -> str:
        server = self.server.server
        rooms = server.lobby.rooms.values() if server is not None else []
        return "; ".join(
            f"{room.id}: {room.episode.phase}, step {room.episode.step}, "
            f"holds {dict(room.episode.pauses.until)}, due {room.episode.due()}, seats "
            + ", ".join(
                f"{s.player} {s.name} {s.controller.value}" for s in room.episode.seats.values()
            )
            for room in rooms
        )

    async def nothing_kept(self) -> None:
        """Check that the server discards the episodes and their participants some time later."""
        deadline = self.loop.time() + FORGOTTEN
        while not self.faults and (kept := self._kept()):
            if self.loop.time() > deadline:
                self.fail(f"still kept: {kept}; {self._where()}")
                return
            await asyncio.sleep(5)

    def _kept(self) -> str:
        server = self.server.server
        if server is None:
            return "the server does not start"
        kept = [f"room {room}" for room in server.lobby.rooms]
        kept += [f"session of {s.name}" for s in server.sessions.by_id.values()]
        kept += [f"{t.name} has no end" for t in self.oracle.files.values() if not t.over]
        kept += [repr(connection) for connection in self.network.connections()]
        return ", ".join(kept)

    async def shut_down(self) -> None:
        """Stop the server and check that nothing is left and that every recording verifies."""
        if self.faults:
            return
        await self.server.stop()
        for connection in self.network.connections():
            self.fail(f"open connection: {connection}")
        for truth in self.oracle.files.values():
            truth.check_end()

    def check_leaks(self, process: Process) -> None:
        """Report tasks and timers that a stopped server has left behind."""
        bad_network = not self.ending
        for task in process.tasks():
            code = task.get_coro().cr_code  # type: ignore[union-attr]
            closing = bad_network and "websockets" in code.co_filename
            if task is not asyncio.current_task() and not closing:
                self.fail(f"{process.name}: unfinished task: {code.co_qualname}")
        for timer in self.loop.pending(process):
            what = getattr(timer._callback, "__qualname__", "?")
            passing = bad_network and what.startswith(PASSING)
            if not (passing or what.startswith(IN_FLIGHT)):
                self.fail(f"{process.name}: pending timer: {what}")

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


def run_seed(seed: int, *, trace: bool = False) -> Report:
    """Simulate a seed. The same seed gives the same course in every process.

    The garbage collector is off during the run, because it would run finalizers at varying times.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        return Simulation(seed, trace=trace).run()
    finally:
        if collecting:
            gc.enable()
