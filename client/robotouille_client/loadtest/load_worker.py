"""One process of the load tester, which plays its share of the bots.

It reads its share and then commands from standard input, and writes a report every second to
standard output. Each is one line of JSON, except that commands are plain words.
"""

from __future__ import annotations

import asyncio
import gc
import json
import os
import random
import select
import selectors
import signal
import sys
import time
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import Any

from robotouille.episode.rules import Clock
from robotouille.errors import RobotouilleError
from robotouille_client.loadtest.bot_rooms import BotRoom, Pinger, SlowReader, Spectator
from robotouille_client.loadtest.histogram import Measurements
from robotouille_client.loadtest.participant import Environment, Participant
from robotouille_client.loadtest.players import Player
from robotouille_client.loadtest.worker_pool import keep_to_cores
from robotouille_client.loadtest.workload import WorkerShare

INTERVAL = 1.0
"""Seconds between two reports."""
TICK = 0.02
"""Seconds between two measurements of this process's own lag."""
AT_ONCE = 64
"""Number of connections that are being opened at a time."""
QUIET_RATE = 0.1
"""Steps per second of the episodes that idle spectators watch."""

Opening = Callable[[], Coroutine[Any, Any, None]]


class LoadWorker:
    """A share of the bots. `report` is called with the plain values of each report."""

    def __init__(
        self, share: WorkerShare, report: Callable[[dict[str, Any]], None], token: str | None = None
    ) -> None:
        self.share = share
        self.environment = Environment(share.url, token=token, rng=random.Random(share.seed))
        self.rooms: list[BotRoom] = []
        self.quiet: list[BotRoom] = []
        self.watching: list[Participant] = []
        self._report = report
        self._measuring = False
        self._loop = asyncio.get_running_loop()
        self._opening = asyncio.Semaphore(AT_ONCE)
        self._since = self._loop.time()
        self._cpu = time.process_time()
        self._timers: dict[str, asyncio.TimerHandle] = {}
        self._storms: set[asyncio.Task[None]] = set()

    # Commands

    async def open(self) -> None:
        """Open the rooms evenly over the ramp."""
        self._flush_at(self._since + INTERVAL)
        self._tick(self._loop.time() + TICK)
        pinger = Pinger(self.environment, f"ping-{self.share.index}")
        self.watching.append(pinger)
        await self._begun(pinger.start)
        share = self.share
        self.rooms = [
            BotRoom(self.environment, f"b{share.index}-{n}", share.task, clock, share.rate)
            for n, clock in enumerate(share.rooms)
        ]
        await self._spread([room.open for room in self.rooms])
        codes = [room.code for room in self.rooms if room.code is not None]
        readers = [
            SlowReader(self.environment, f"slow{share.index}-{n}")
            for n in range(share.slow_readers if codes else 0)
        ]
        self.watching += readers
        await self._spread(
            [partial(reader.watch, codes[n % len(codes)]) for n, reader in enumerate(readers)]
        )

    async def spectate(self) -> None:
        """Open quiet rooms and let idle spectators join them."""
        share = self.share
        count = -(-share.spectators // share.spectators_per_room)
        self.quiet = [
            BotRoom(self.environment, f"q{share.index}-{n}", share.task, Clock.LOCKSTEP, QUIET_RATE)
            for n in range(count)
        ]
        await self._spread([room.open for room in self.quiet])
        codes = [room.code for room in self.quiet if room.code is not None]
        spectators = [
            Spectator(self.environment, f"s{share.index}-{n}")
            for n in range(share.spectators if codes else 0)
        ]
        self.watching += spectators
        await self._spread(
            [
                partial(bot.watch, codes[n // share.spectators_per_room % len(codes)])
                for n, bot in enumerate(spectators)
            ]
        )

    def measure(self) -> None:
        """Start measuring."""
        self._flush()
        # Full collections of thousands of bots would show as lag of the server.
        gc.collect()
        gc.freeze()
        for room in self.rooms:
            room.actor.measure()
        self._measuring = True

    def storm(self) -> int:
        """Cut connections of players at once, let them return, and return their number."""
        seated = [
            (room, player)
            for room in self.rooms
            for player in room.players
            if player.connection is not None and player.seat is not None
        ]
        chosen: list[tuple[BotRoom, Player]] = self.environment.rng.sample(
            seated, min(self.share.storm, len(seated))
        )
        now = self._loop.time()
        for _, player in chosen:
            player.cut()
        for room, player in chosen:
            task = self._loop.create_task(room.storm(player, now))
            self._storms.add(task)
            task.add_done_callback(self._storms.discard)
        return len(chosen)

    def stop(self) -> None:
        """Send the last report and close all connections."""
        self._flush()
        for timer in self._timers.values():
            timer.cancel()
        for task in self._storms:
            task.cancel()
        for room in (*self.rooms, *self.quiet):
            room.close()
        for participant in self.watching:
            participant.close()

    # Opening

    async def _spread(self, openings: Sequence[Opening]) -> None:
        # Evenly over the ramp, but at most AT_ONCE at a time.
        start = self._loop.time()
        tasks = []
        for number, opening in enumerate(openings):
            due = start + self.share.ramp * number / len(openings)
            if due > self._loop.time():
                await asyncio.sleep(due - self._loop.time())
            await self._opening.acquire()
            task = self._loop.create_task(self._begun(opening))
            task.add_done_callback(lambda _: self._opening.release())
            tasks.append(task)
        await asyncio.gather(*tasks)

    async def _begun(self, opening: Opening) -> None:
        begun = self._loop.time()
        try:
            await opening()
        except RobotouilleError as error:
            self.environment.measured.count(f"not begun: {error}")
        else:
            self.environment.measured.took("opening", self._loop.time() - begun)

    # Reporting

    def _tick(self, due: float) -> None:
        # The clients share the machine, so the report must show when they are late themselves.
        now = self._loop.time()
        while due <= now:
            self.environment.measured.took("client lag", now - due)
            due += TICK
        self._timers["tick"] = self._loop.call_at(due, self._tick, due)

    def _flush_at(self, due: float) -> None:
        if self._loop.time() >= due:
            self._flush()
            due += INTERVAL
        self._timers["flush"] = self._loop.call_at(due, self._flush_at, due)

    def _flush(self) -> None:
        environment, now = self.environment, self._loop.time()
        measured, environment.measured = environment.measured, Measurements()
        seconds, self._since = now - self._since, now
        realtime = [room for room in self.rooms if room.clock is Clock.REALTIME]
        due = seconds * self.share.rate * sum(room.playing for room in realtime)
        measured.count("steps due", due)
        traffic = environment.traffic
        for name in ("bytes_in", "bytes_out", "messages_in", "messages_out"):
            measured.count(name.replace("_", " "), getattr(traffic, name))
            setattr(traffic, name, 0)
        cpu, self._cpu = time.process_time() - self._cpu, time.process_time()
        self._report(
            {
                "kind": "interval",
                "worker": self.share.index,
                "at": now,
                "seconds": seconds,
                "measured": self._measuring,
                "connected": environment.connected,
                "playing": sum(room.playing for room in self.rooms),
                "cpu": cpu,
                **measured.to_json(),
            }
        )


async def _run(lines: asyncio.StreamReader) -> None:
    share = WorkerShare.model_validate_json(await lines.readline())
    worker = LoadWorker(share, _print, os.environ.get("ROBOTOUILLE_TOKEN"))
    tasks = []
    while command := (await lines.readline()).decode().strip():
        if command == "stop":
            break
        tasks.append(asyncio.create_task(_obey(worker, command)))
    for task in tasks:
        task.cancel()
    worker.stop()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _obey(worker: LoadWorker, command: str) -> None:
    cut = 0
    if command == "open":
        await worker.open()
    elif command == "spectate":
        await worker.spectate()
    elif command == "measure":
        worker.measure()
    elif command == "storm":
        cut = worker.storm()
    _print({"kind": "done", "worker": worker.share.index, "command": command, "cut": cut})


def _print(plain: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(plain, separators=(",", ":")) + "\n")
    sys.stdout.flush()


async def _main() -> None:
    loop = asyncio.get_running_loop()
    lines = asyncio.StreamReader(limit=2**24)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    await _run(lines)


def main() -> None:
    """Run a worker on the cores that its argument lists."""
    # Ctrl+C reaches the whole process group. The parent handles it and then sends `stop`.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if len(sys.argv) > 1:
        keep_to_cores(tuple(map(int, sys.argv[1].split(","))))
    with asyncio.Runner(loop_factory=_precise_loop) as runner:
        runner.run(_main())


_SELECT_LIMIT = 1024
"""`select` accepts only descriptors below this number."""


def _precise_loop() -> asyncio.AbstractEventLoop:
    """Return a new event loop with timers of microseconds, if the system allows it."""
    if not hasattr(selectors, "EpollSelector"):
        return asyncio.new_event_loop()
    selector = _PreciseSelector()
    if selector.fileno() >= _SELECT_LIMIT:
        selector.close()
        return asyncio.new_event_loop()
    return asyncio.SelectorEventLoop(selector)


if hasattr(selectors, "EpollSelector"):

    class _PreciseSelector(selectors.EpollSelector):
        """Selector that waits with `select`, because `epoll` rounds up to milliseconds."""

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            if timeout is None or timeout <= 0:
                return super().select(timeout)
            select.select((self.fileno(),), (), (), timeout)
            return super().select(0)


if __name__ == "__main__":
    main()
