"""The server's machine: processes that start and end on one disk and one port."""

from __future__ import annotations

import asyncio
import random
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotouille_server import Server, ServerSettings, serve
from robotouille_server.app import CannotListenError, Surroundings
from robotouille_server.rooms.substitutes.bot_worker import ThreadBotWorker
from robotouille_server.rooms.substitutes.bots import Bots, BotWorld
from tests.programs.simulation.clients import PORT
from tests.programs.simulation.loop import Process
from tests.support.executors import ImmediateExecutor

if TYPE_CHECKING:
    from tests.programs.simulation.simulation import Simulation

__all__ = ["ServerMachine"]

KITCHENS: OrderedDict[str, BotWorld] = OrderedDict()
"""Knowledge of substitutes, shared by all servers and seeds; it does not change their replies."""

KEYS = "simulated:" + "A" * 43


class ServerMachine:
    """The server's machine: consecutive processes on one disk and one port, with a supervisor that
    restarts a process that dies.
    """

    def __init__(self, sim: Simulation, settings: dict[str, Any]) -> None:
        self.sim = sim
        self.settings = ServerSettings(
            port=PORT, recordings=Path("simulated"), signing_keys=KEYS, **settings
        )
        self.process: Process | None = None
        self.server: Server | None = None
        self.starts = 0
        self._chance = random.Random(f"{sim.seed}/restarts")
        self._retire: asyncio.Future[float | None] | None = None
        self._main: asyncio.Task[None] | None = None

    def boot(self) -> None:
        """Start a process that serves until it is stopped or killed."""
        self.starts += 1
        process = self.process = Process(f"server.{self.starts}", self.sim.loop)
        self.server = None
        self.sim.processes.append(process)
        process.on_death.append(lambda: self._died(process))
        self._retire = self.sim.loop.create_future()
        self._main = process.start(self._serve(process, self._retire))

    def _died(self, process: Process) -> None:
        self.sim.trace("fault", "death", process.name)
        self.sim.network.close_all(process)
        if process is self.process and not self.sim.ending:
            self.server = None
            delay = 10 ** self._chance.uniform(-2, 0.7)
            self.sim.loop.call_later(delay, self.boot, context=self.sim.context)

    async def _serve(self, process: Process, retire: asyncio.Future[float | None]) -> None:
        options: dict[str, Any] = {
            "randomness": random.Random(f"{self.sim.seed}/{process.name}"),
            "timestamp": lambda: f"20260101T{int(self.sim.loop.time()):06d}Z",
            "storage": self.sim.disk,
            "wall": lambda: 1_700_000_000 + self.sim.loop.time(),
            "bot_worker": lambda: ThreadBotWorker(ImmediateExecutor(), Bots(KITCHENS)),
        }
        while True:
            try:
                async with serve(self.settings, Surroundings(**options)) as server:
                    if process is self.process:
                        self.server = server
                    drain = await retire
                    if drain is not None:
                        await server.drain(drain)
                        await server.stop("a new process takes over", hand_over=True)
                break
            except CannotListenError:
                await asyncio.sleep(1.0)
        self.sim.check_leaks(process)
        process.kill()

    def hand_over(self, seconds: float) -> bool:
        """Let the process drain, and start the next one on the same disk and port."""
        if self.server is None or self._retire is None or self._retire.done():
            return False
        self._retire.set_result(seconds)
        self.boot()
        return True

    async def stop(self) -> None:
        """Stop the server like an operator, and wait until it has ended."""
        while self.server is None:
            await asyncio.sleep(1.0)
        self.sim.ending = True
        if self._retire is not None and self._main is not None:
            self._retire.set_result(None)
            await self._main
