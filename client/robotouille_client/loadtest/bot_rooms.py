"""The bots of a load test: rooms with players, spectators, slow readers and a pinger."""

from __future__ import annotations

import asyncio
from collections import deque

from robotouille import World
from robotouille.episode.rules import Clock
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_client.loadtest.participant import Environment, Participant, RawMessage
from robotouille_client.loadtest.players import Actor, Bystander, Player, back_and_forth

MANY_STEPS = 1_000_000
"""Step limit of the episodes, so that they last for the whole test."""
RESYNC_SECONDS = 0.05
PING_SECONDS = 0.05


class BotRoom:
    """An episode with bots in all seats. When it ends, they open another one."""

    def __init__(
        self, environment: Environment, name: str, task: str, clock: Clock, rate: float
    ) -> None:
        players = World(task).players
        self.clock = clock
        self.code: str | None = None
        self.actor = Actor(environment, f"{name}-1", clock, rate, back_and_forth(task, players[0]))
        self.partners = [
            Bystander(environment, f"{name}-{number}", clock)
            for number in range(2, len(players) + 1)
        ]
        self._environment = environment
        self._create: RawMessage = {
            "type": "create", "task": task, "clock": clock.value, "timing": "benchmark",
            "step_rate": rate, "max_steps": MANY_STEPS,
        }  # fmt: skip
        self._tasks: set[asyncio.Task[None]] = set()
        for player in self.players:
            player.on_interrupted = lambda player=player: self._spawn(self._bring_back(player))  # type: ignore[misc]
        self.actor.on_over = lambda: self._spawn(self._again())

    @property
    def players(self) -> list[Player]:
        return [self.actor, *self.partners]

    @property
    def playing(self) -> bool:
        return self.actor.playing and self.actor.connection is not None

    async def open(self) -> None:
        """Connect all players and start an episode.

        Raises:
            RobotouilleError: The server refuses or cannot be reached.
        """
        try:
            await asyncio.gather(*(player.introduce() for player in self.players))
            await self._begin()
        except RobotouilleError:
            self.close()
            raise

    async def _begin(self) -> None:
        created = await self.actor.ask(self._create, "created")
        self.code = created["code"]
        for player in self.players:
            await player.enter(created["code"])

    async def _again(self) -> None:
        self._environment.measured.count("episodes ended")
        try:
            for player in self.players:
                await player.ask({"type": "leave"}, "left")
            await self._begin()
        except RobotouilleError as error:
            self._environment.measured.count(f"not played again: {_code(error)}")

    async def _bring_back(self, player: Player) -> None:
        try:
            await player.return_to_seat()
        except ProtocolError as error:
            self._environment.measured.count(f"not returned: {error.code}")

    async def storm(self, player: Player, cut_at: float) -> None:
        """Bring back a player whose connection was cut at `cut_at`, and measure the time."""
        try:
            await player.return_to_seat()
        except ProtocolError as error:
            self._environment.measured.count(f"not returned: {error.code}")
            self._environment.measured.count("lost in the storm")
        else:
            took = asyncio.get_running_loop().time() - cut_at
            self._environment.measured.took("return", took)

    def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        for player in self.players:
            player.close()

    def _spawn(self, coroutine: object) -> None:
        task = asyncio.ensure_future(coroutine)  # type: ignore[call-overload]
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


class Spectator(Participant):
    """Spectator that only reads."""

    async def watch(self, code: str) -> None:
        await self.introduce()
        await self.enter(code, role="spectator")

    def heard(self, message: RawMessage) -> None:
        if message["type"] == "delta":
            self.environment.measured.count("deltas to spectators")


class SlowReader(Spectator):
    """Spectator that keeps requesting snapshots and reads none of them."""

    def __init__(self, environment: Environment, name: str) -> None:
        super().__init__(environment, name)
        self._timer: asyncio.TimerHandle | None = None

    async def watch(self, code: str) -> None:
        await super().watch(code)
        if self.connection is not None:
            self.connection.stop_reading()
        self._demand()

    def _demand(self) -> None:
        if self.connection is not None:
            self.send({"type": "resync"})
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(RESYNC_SECONDS, self._demand)

    def interrupted(self) -> None:
        self.environment.measured.count("slow readers dropped")

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        super().close()


class Pinger(Participant):
    """Participant without a game that measures round trips through the server's event loop."""

    def __init__(self, environment: Environment, name: str) -> None:
        super().__init__(environment, name)
        self._sent: deque[float] = deque()
        self._timer: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()

    async def start(self) -> None:
        await self.introduce()
        if self.connection is not None:
            self.connection.ponged = self._ponged
        self._ping(self._loop.time())

    def _ping(self, due: float) -> None:
        if self.connection is not None:
            self._sent.append(due)
            self.connection.ping()
            self._timer = self._loop.call_at(due + PING_SECONDS, self._ping, due + PING_SECONDS)

    def _ponged(self) -> None:
        took = self._loop.time() - self._sent.popleft()
        environment = self.environment
        environment.measured.took("ping", took)
        environment.transit = min(environment.transit or took, took / 2)

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        super().close()


def _code(error: RobotouilleError) -> str:
    return error.code if isinstance(error, ProtocolError) else str(error)
