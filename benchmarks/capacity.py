"""How many real-time episodes one server process holds, beside a bare `websockets` server.

Rooms of two clients, ten steps a second, one of the two acting in every step. A count holds when
99 % of the steps are taken less than 20 ms after they are due. Both servers run in a process of
their own; the clients in another.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import msgpack
from websockets.asyncio.client import connect
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed

RATE = 10
LATE = 0.020
SECONDS = 6.0
DELTA = 95
"""Bytes of the bare server's messages: the median delta of such a game."""


def run_ours(ready: Any) -> None:
    """The server under test, in a process of its own."""
    from robotouille_server import ServerSettings
    from robotouille_server import serve as serve_robotouille
    from robotouille_server.logs import configure_logs

    configure_logs("error", "console")

    async def main() -> None:
        folder = Path(tempfile.mkdtemp())
        settings = ServerSettings(
            port=0, recordings=folder, max_steps=100_000, max_episodes=10_000, step_rate=RATE
        )
        async with serve_robotouille(settings) as server:
            ready.send(server.port)
            await asyncio.Event().wait()

    asyncio.run(main())


def run_bare(ready: Any) -> None:
    """The least a server could do: the same messages from an absolute schedule."""

    async def main() -> None:
        lateness: list[float] = []
        waiting: list[ServerConnection] = []
        payload = b"x" * DELTA
        loop = asyncio.get_running_loop()

        def step(room: list[ServerConnection], due: float) -> None:
            lateness.append(loop.time() - due)
            broadcast(room, payload)
            if any(socket.state.value == 1 for socket in room):
                loop.call_at(due + 1 / RATE, step, room, due + 1 / RATE)

        def http(connection: ServerConnection, request: Any) -> Any:
            if request.path == "/lateness":
                counts = [len(lateness), sum(late <= LATE for late in lateness)]
                return connection.respond(200, json.dumps(counts))
            return None

        async def handle(socket: ServerConnection) -> None:
            waiting.append(socket)
            if len(waiting) == 2:
                room = waiting.copy()
                waiting.clear()
                loop.call_later(1 / RATE, step, room, loop.time() + 1 / RATE)
            try:
                async for _ in socket:
                    pass
            except ConnectionClosed:
                pass

        async with serve(handle, "127.0.0.1", 0, compression=None, process_request=http) as server:
            ready.send(next(iter(server.sockets)).getsockname()[1])
            await asyncio.Event().wait()

    asyncio.run(main())


def lateness_of(port: int, ours: bool) -> tuple[int, int]:
    """Steps taken so far, and those of them in time."""
    page = urlopen(f"http://127.0.0.1:{port}/{'metrics' if ours else 'lateness'}", timeout=20)
    text = page.read().decode()
    if not ours:
        total, punctual = json.loads(text)
        return total, punctual
    total = re.search(r"lateness_seconds_count (\S+)", text)
    punctual = re.search(rf'lateness_seconds_bucket{{le="{LATE}"}} (\S+)', text)
    return int(float(total[1])) if total else 0, int(float(punctual[1])) if punctual else 0


async def our_pair(url: str, playing: asyncio.Semaphore) -> None:
    """Two clients in one room; the first walks to and fro, one step after the other."""
    protocol: Any = ["robotouille.v1.msgpack"]
    async with (
        connect(url, subprotocols=protocol, compression=None, ping_interval=None) as first,
        connect(url, subprotocols=protocol, compression=None, ping_interval=None) as second,
    ):
        for socket in (first, second):
            await socket.send(msgpack.packb({"type": "hello", "protocol": 1, "name": "load"}))
        await first.send(
            msgpack.packb({"type": "create", "task": "multi_agent/01", "clock": "realtime",
                           "timing": "benchmark"})
        )  # fmt: skip
        code = None
        while code is None:
            code = msgpack.unpackb(await first.recv()).get("code")
        for socket in (first, second):
            await socket.send(msgpack.packb({"type": "join", "episode": code}))
        await asyncio.gather(walk_about(first), drain(second, playing))


async def walk_about(socket: Any) -> None:
    from robotouille import World

    world = World("multi_agent/01")
    state = world.initial
    there = next(a for a in state.actions("robot1") if a.name == "move")
    back = [there.arguments[0], there.arguments[2], there.arguments[1]]
    moves = [{"name": "move", "args": list(there.arguments)}, {"name": "move", "args": back}]
    marker = msgpack.packb("delta")
    seq = 0
    while True:
        payload = await socket.recv()
        if marker in payload[:16]:
            await socket.send(
                msgpack.packb({"type": "act", "seq": seq + 1, "action": moves[seq % 2]})
            )
            seq += 1


async def bare_pair(url: str, playing: asyncio.Semaphore) -> None:
    async with (
        connect(url, compression=None, ping_interval=None) as first,
        connect(url, compression=None, ping_interval=None) as second,
    ):
        await asyncio.gather(answer(first), drain(second, playing))


async def answer(socket: Any) -> None:
    action = b"y" * 70
    while True:
        await socket.recv()
        await socket.send(action)


async def drain(socket: Any, playing: asyncio.Semaphore) -> None:
    """Read everything; report the pair as playing once steps come."""
    for _ in range(5):
        await socket.recv()
    playing.release()
    while True:
        await socket.recv()


async def load(port: int, rooms: int, ours: bool) -> float:
    """The share of steps in time while `rooms` rooms play for a while."""
    playing = asyncio.Semaphore(0)
    pair = our_pair if ours else bare_pair
    tasks = []
    for _ in range(rooms):
        tasks.append(asyncio.create_task(pair(f"ws://127.0.0.1:{port}", playing)))
        await asyncio.sleep(0.01)
    try:
        async with asyncio.timeout(30):
            for _ in range(rooms):
                await playing.acquire()
        await asyncio.sleep(2.0)
        before = await asyncio.to_thread(lateness_of, port, ours)
        await asyncio.sleep(SECONDS)
        after = await asyncio.to_thread(lateness_of, port, ours)
    except TimeoutError:
        return 0.0
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    taken = after[0] - before[0]
    return (after[1] - before[1]) / taken if taken > 0.97 * rooms * RATE * SECONDS else 0.0


def attempt(rooms: int, ours: bool) -> float:
    """One run with fresh processes."""
    parent, child = multiprocessing.Pipe()
    target = run_ours if ours else run_bare
    process = multiprocessing.get_context("spawn").Process(target=target, args=(child,))
    process.start()
    try:
        port = parent.recv()
        return asyncio.run(load(port, rooms, ours))
    except (OSError, EOFError, TimeoutError):
        return 0.0
    finally:
        process.terminate()
        process.join(timeout=10)
        if process.is_alive():
            process.kill()


def capacity(ours: bool, start: int, limit: int) -> int:
    """The largest count that holds, found by doubling and halving to within 10 %."""
    name = "robotouille-server" if ours else "bare websockets"
    good, bad, rooms = 0, 0, start
    while rooms <= limit and (bad == 0 or bad - good > max(10, good // 10)):
        share = attempt(rooms, ours)
        holds = share >= 0.99
        print(f"  {name}: {rooms} rooms, {share:.2%} in time", file=sys.stderr, flush=True)
        good, bad = (rooms, bad) if holds else (good, rooms)
        rooms = (good + bad) // 2 if bad else rooms * 2
    return good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--start", type=int, default=150)
    parser.add_argument("--limit", type=int, default=4000)
    arguments = parser.parse_args()
    begun = time.monotonic()
    bare = capacity(False, arguments.start * 2, arguments.limit)
    ours = capacity(True, arguments.start, arguments.limit)
    print(f"real-time episodes of 2 players at {RATE} steps/s with 99 % less than 20 ms late:")
    print(f"  robotouille-server {ours}")
    print(f"  bare websockets    {bare} (same message sizes and rates, no game)")
    print(f"  ratio              {ours / bare:.2f}" if bare else "  ratio n/a")
    print(f"  ({time.monotonic() - begun:.0f} s)")


if __name__ == "__main__":
    main()
