"""Measure how hundreds of substitutes affect another game, and how often they act.

python -m benchmarks.substitutes --rooms 100 --seconds 25

Each room has four seats and takes five steps per second. Three of its participants leave as soon as
the game has begun, and substitutes take their seats. One more game has two participants who stay;
its deltas are timed.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import AsyncExitStack, contextmanager
from itertools import pairwise
from urllib.request import urlopen

from robotouille_client import Game, StateChanged, connect

RATE = 5.0
TASKS = ("multi_agent/07@4", "multi_agent/08@4", "multi_agent/09@4", "multi_agent/10@4")
LIMITS = ("--messages-per-second", "1000", "--max-connections-per-address", "2000",
          "--max-episodes", "2000", "--max-episodes-per-owner", "2000")  # fmt: skip


@contextmanager
def server() -> Iterator[str]:
    """Run a server in a separate process and yield its URL."""
    with tempfile.TemporaryDirectory() as folder:
        program = "from robotouille_server.cli import main; main()"
        flags = ("--port", "0", "--recordings", f"{folder}/recordings", "--no-operator", *LIMITS)
        process = subprocess.Popen(
            [sys.executable, "-c", program, *flags],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert process.stdout is not None
        try:
            yield re.search(r"ws://\S+", process.stdout.readline()).group()  # type: ignore[union-attr]
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()


async def play(
    stack: AsyncExitStack, going: AsyncExitStack, url: str, task: str, stay: int
) -> Game:
    """Open a game whose first `stay` participants stay; return the first participant's game."""
    first = await stack.enter_async_context(connect(url, name="stays"))
    created = await first.create(
        task, clock="realtime", step_rate=RATE, absence="bot", max_steps=100_000
    )
    game = await first.join(created.code)
    for number in range(1, len(game.seats)):
        others = stack if number < stay else going
        client = await others.enter_async_context(connect(url, name="another"))
        await client.join(created.code)
    return game


async def deltas(game: Game, seconds: float) -> list[float]:
    """Return the times at which the deltas of a game arrive."""
    loop, times = asyncio.get_running_loop(), []
    end = loop.time() + seconds
    while loop.time() < end:
        if isinstance(await game.next_event(), StateChanged):
            times.append(loop.time())
    return times


def moves(url: str) -> float:
    page = urlopen(url.replace("ws:", "http:") + "/metrics").read().decode()
    return float(re.search(r'robotouille_moves_total{result="applied"} (\S+)', page).group(1))  # type: ignore[union-attr]


async def fill(url: str, rooms: int) -> None:
    """Open the rooms, print `ready`, and stay in them."""
    async with AsyncExitStack() as stack:
        for number in range(rooms):
            async with AsyncExitStack() as going:
                await play(stack, going, url, TASKS[number % len(TASKS)], stay=1)
        print("ready", flush=True)
        await asyncio.Event().wait()


async def trial(url: str, rooms: int, seconds: float) -> None:
    """Time the deltas of one game while another process fills the other rooms."""
    command = [sys.executable, "-m", "benchmarks.substitutes", "--rooms", str(rooms), "--fill", url]
    async with AsyncExitStack() as stack:
        others = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
        assert others.stdout is not None
        await others.stdout.readline()
        honest = await play(stack, stack, url, "multi_agent/01", stay=2)
        before = await asyncio.to_thread(moves, url)
        times = await deltas(honest, seconds)
        moved = await asyncio.to_thread(moves, url) - before
        others.kill()
        await others.wait()
    gaps = sorted(after - at for at, after in pairwise(times))
    late = sum(gap > 1 / RATE + 0.05 for gap in gaps) / len(gaps)
    print(
        f"{rooms} rooms: longest gap {gaps[-1] * 1000:.0f} ms (nominal {1000 / RATE:.0f}), "
        f"{late:.1%} more than 50 ms late, {moved:.0f} actions of substitutes "
        f"({moved / seconds / max(1, rooms):.2f} per second and room)"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the measurement; `--fill` is internal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=25.0)
    parser.add_argument("--fill", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.fill:
        asyncio.run(fill(options.fill, options.rooms))
        return
    with server() as url:
        asyncio.run(trial(url, options.rooms, options.seconds))


if __name__ == "__main__":
    main()
