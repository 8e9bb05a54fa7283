"""Source of faults, with times and kinds that the seed determines. It repairs them at the end."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from typing import TYPE_CHECKING

from tests.programs.simulation.frames import Unit, UnitKind, payload_of
from tests.programs.simulation.scenario import Scenario
from tests.programs.simulation.stranger import Stranger
from tests.programs.simulation.transport import Connection

if TYPE_CHECKING:
    from tests.programs.simulation.clients import Participant
    from tests.programs.simulation.simulation import Simulation

__all__ = ["Adversary"]

PORT = 8765


class LossyLink:
    """Link that drops, repeats and delays whole messages, unlike TCP. Its connection is cut soon
    afterwards, like one that lost its last messages.
    """

    def __init__(self, chance: random.Random, rate: float, span: float) -> None:
        self._random = chance
        self._rate = rate
        self._span = span

    def treat(self, unit: Unit) -> list[float]:
        if unit.kind is not UnitKind.MESSAGE or self._random.random() > self._rate:
            return [0.0]
        what = self._random.random()
        if what < 0.4:
            return []
        if what < 0.6 and b"say" not in payload_of(unit.data):
            return [0.0, self._random.random() * self._span]
        return [0.001 + self._random.random() * self._span]


class Adversary:
    """Causes faults for a limited time."""

    def __init__(self, sim: Simulation, scenario: Scenario, chance: random.Random) -> None:
        self.sim = sim
        self.scenario = scenario
        self.done: list[str] = []
        self.mangled: set[str] = set()
        self.strangers: list[Stranger] = []
        self._random = chance
        self._mangles = scenario.faults.pop("mangle", 0.0)
        self._lossy: list[Connection] = []
        self._timers: list[asyncio.TimerHandle] = []
        sim.network.on_connect = self._connected

    async def trouble(self) -> None:
        """Cause one fault after another, then repair everything."""
        end = self.sim.loop.time() + self.scenario.trouble
        kinds = sorted(self.scenario.faults)
        weights = [self.scenario.faults[kind] for kind in kinds]
        while kinds and not self.sim.faults:
            await asyncio.sleep(self._random.expovariate(1 / self.scenario.pause))
            if self.sim.loop.time() > end:
                break
            kind = self._random.choices(kinds, weights)[0]
            fault: Callable[[], str] = getattr(self, kind)
            if what := fault():
                self.sim.trace("fault", kind, what)
                self.done.append(kind)
                self.sim.compare_server()
        self.heal()

    def heal(self) -> None:
        """Repair everything and stop causing faults."""
        self.sim.trace("fault", "heal", "")
        sim = self.sim
        sim.network.on_connect = None
        sim.network.refusing = ""
        sim.disk.full = False
        sim.disk.dies_after = None
        sim.network.conditions.window = 65536
        for timer in self._timers:
            timer.cancel()
        for participant in sim.participants:
            if not participant.done and participant.lives and not participant.tries:
                participant.start(participant.token)
        for process in sim.processes:
            process.dies_at = None
            if process.suspended:
                process.wake()
        for connection in sim.network.connections():
            for pipe in connection.pipes:
                pipe.mangler = None
                if pipe.stalled:
                    pipe.flow()
                pipe.sender.has_room()
        for connection in self._lossy:
            connection.cut()
        for stranger in self.strangers:
            stranger.process.kill()

    def _later(self, delay: float, act: Callable[..., None], *values: object) -> None:
        now = self.sim.loop.time()
        self._timers = [timer for timer in self._timers if timer.when() > now]
        self._timers.append(self.sim.loop.call_later(delay, act, *values))

    def _seconds(self) -> float:
        """Draw a duration, which is mostly short but sometimes exceeds every timeout."""
        return float(10 ** self._random.uniform(-1.5, 1.7))

    # The network

    def _connected(self, connection: Connection) -> None:
        if self._random.random() < self._mangles * 0.4:
            rate, span = self._random.choice((0.02, 0.1, 0.3)), self._random.choice((0.05, 1.0))
            for pipe in connection.pipes:
                pipe.mangler = LossyLink(self._random, rate, span)
            self._lossy = [known for known in self._lossy if known.alive]
            self._lossy.append(connection)
            client = connection.ends[0].process
            if client is not None:
                self.mangled.add(client.name)
            self.done.append("mangle")
            self._later(self._random.uniform(0.3, 8.0), connection.cut)

    def _connection(self) -> Connection | None:
        connections = self.sim.network.connections()
        return self._random.choice(connections) if connections else None

    def cut(self) -> str:
        connection = self._connection()
        if connection is None:
            return ""
        connection.cut()
        return str(connection.number)

    def cut_one_side(self) -> str:
        connection = self._connection()
        if connection is None:
            return ""
        client = self._random.random() < 0.5
        connection.cut_for(client)
        return f"{connection.number} {'client' if client else 'server'}"

    def stall(self) -> str:
        connection = self._connection()
        if connection is None:
            return ""
        pipes = self._random.choice((connection.pipes, connection.pipes[:1], connection.pipes[1:]))
        seconds = self._seconds()
        for pipe in pipes:
            if not pipe.stalled:
                pipe.stall()
                self._later(seconds, pipe.flow)
        return f"{connection.number} {len(pipes)} {seconds:.3f}"

    def refuse(self) -> str:
        self.sim.network.refusing = self._random.choice(("loud", "silent"))
        seconds = min(5.0, self._seconds())

        def accept() -> None:
            self.sim.network.refusing = ""

        self._later(seconds, accept)
        return f"{self.sim.network.refusing} {seconds:.3f}"

    def flood(self) -> str:
        """Let a stranger send far more than the limits allow; no episode may notice."""
        name = f"stranger-{len(self.strangers)}"
        code = self._random.choice([plan.code for plan in self.sim.plans] or [None])
        stranger = Stranger(name, self.sim.loop, self._random, code)
        self.strangers.append(stranger)
        self.sim.processes.append(stranger.process)
        stranger.start(PORT)
        return stranger.flood

    # Clients

    def _participant(self) -> Participant | None:
        living = [p for p in self.sim.participants if not p.done and p.process is not None]
        living = [p for p in living if p.process is not None and not p.process.dead]
        return self._random.choice(living) if living else None

    def freeze_client(self) -> str:
        participant = self._participant()
        if participant is None or participant.process is None or participant.process.suspended:
            return ""
        seconds = self._seconds()
        participant.process.suspend()
        self._later(seconds, participant.process.wake)
        return f"{participant.name} {seconds:.3f}"

    def kill_client(self) -> str:
        return self._kill_client(silently=False)

    def lose_machine(self) -> str:
        return self._kill_client(silently=True)

    def _kill_client(self, *, silently: bool) -> str:
        participant = self._participant()
        if participant is None or participant.process is None:
            return ""
        token = participant.token if self._random.random() < 0.7 else None
        if silently:
            self.sim.network.close_all(participant.process, silently=True)
        participant.process.kill()
        if self._random.random() < 0.15 and participant.plan.begun:
            participant.done = True
            return f"{participant.name} permanently"
        self._later(min(20.0, self._seconds()), self._return, participant, token)
        return participant.name

    def _return(self, participant: Participant, token: str | None) -> None:
        participant.start(token)

    def take_over(self) -> str:
        """Connect the same participant from another machine while the first one is connected."""
        participant = self._participant()
        if participant is None or participant.token is None:
            return ""
        participant.start(participant.token)
        return participant.name

    # The server

    def freeze_server(self) -> str:
        process = self.sim.server.process
        if process is None or process.dead or process.suspended:
            return ""
        seconds = min(8.0, self._seconds())
        process.suspend()
        self._later(seconds, process.wake)
        return f"{seconds:.3f}"

    def crash(self) -> str:
        """Kill the server like `kill -9` after a number of callbacks, so at any await."""
        process = self.sim.server.process
        if process is None or process.dead or process.dies_at is not None:
            return ""
        callbacks = int(10 ** self._random.uniform(0, 2.3))
        process.dies_at = process.callbacks + callbacks
        return f"{process.name} after {callbacks}"

    def crash_in_write(self) -> str:
        """Kill the server during an append or while it closes a file."""
        writes = int(10 ** self._random.uniform(0, 1.2))
        self.sim.disk.dies_after = writes
        return str(writes)

    def fill_disk(self) -> str:
        if self.sim.disk.full:
            return ""
        seconds = self._seconds()
        self.sim.disk.full = True
        self._later(seconds, self._empty_disk)
        return f"{seconds:.3f}"

    def _empty_disk(self) -> None:
        self.sim.disk.full = False

    def hand_over(self) -> str:
        """Start a new process that takes over while the old one drains."""
        seconds = self._random.choice((0.0, 1.0, 10.0))
        return f"{seconds}" if self.sim.server.hand_over(seconds) else ""
