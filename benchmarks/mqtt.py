"""What MQTT costs a server: off, on with nobody listening, and with all episodes watched.

The server has one core to itself, the clients and the broker the others. The processor time that
it takes is measured in turns, so that what else the machine does hits all alike.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import sys
import tempfile
import time
import timeit
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rich.console import Console
from tests.support.brokers import Mosquitto, missing, mosquitto

from benchmarks.server import OURS, Bench, Row, load, print_rows
from robotouille import World
from robotouille.episode import Episode, Rules, Stepped
from robotouille_client.loadtest.cores import keep_to_cores
from robotouille_server.auth import FileKeyring, Revocations, Role, Tokens
from robotouille_server.mqtt.outbox import Outbox
from robotouille_server.mqtt.tap import Tap
from robotouille_server.mqtt.topics import Topics
from robotouille_server.mqtt.watches import Watches
from robotouille_server.runtime.metrics import Metrics

ROOMS, RATE = 200, 5.0
OFF, SILENT, WATCHED = "off", "nobody listens", "all watched"
MAX_SILENT, MAX_WATCHED = 0.02, 0.10
CALLS = 100_000


def tap_seconds(*, watched: bool) -> float:
    """What telling the tap of a step takes, in seconds."""
    world = World("multi_agent/01")
    episode = Episode(world, Rules(), 0.0)
    for player in world.players:
        episode.join(player, player, "bot", 0.0)
    for player in world.players:
        episode.submit(player, 1, episode.state.actions(player)[0], 0.1)
    (step,) = [event for event in episode.events() if isinstance(event, Stepped)]
    room = cast("Any", SimpleNamespace(id="ad9ac0c99d4665c2"))
    watches = Watches(list)
    watches.episodes = {room.id} if watched else set()
    tap = Tap(Outbox(Metrics()), watches, Topics("bench"), time.time)
    return min(timeit.repeat(lambda: tap.published(room, [step]), number=CALLS, repeat=5)) / CALLS


async def watch(broker: Mosquitto, token: str) -> None:
    """Ask for the steps of all episodes."""
    import aiomqtt

    async with aiomqtt.Client("127.0.0.1", broker.port) as lab:
        topics = Topics("bench")
        await lab.subscribe([(topics.presence, 1), (topics.answers, 1)])
        async for message in lab.messages:
            content = json.loads(message.payload)
            if content.get("state") == "online":
                command = {"type": "watch", "ref": "bench", "token": token}
                await lab.publish(topics.commands, json.dumps(command), qos=1)
            elif content.get("ok"):
                return


@contextmanager
def watching(broker: Mosquitto, token: str) -> Iterator[None]:
    """Somebody who asks for all steps of the next server, once it is there."""
    import threading

    thread = threading.Thread(target=lambda: asyncio.run(watch(broker, token)), daemon=True)
    thread.start()
    yield
    thread.join(5)


def cores(bench: Bench, folder: Path, broker: Mosquitto, case: str, rooms: int) -> float:
    """The share of a core that a server takes."""
    keys = folder / "keys.json"
    tokens = Tokens(FileKeyring(keys), time.time, Revocations(folder / "revoked.json"))
    token = tokens.mint_role(Role.OPERATOR, "bench", seconds=3600)
    flags: tuple[str, ...] = ("--keys", str(keys))
    if case != OFF:
        flags += ("--mqtt", broker.url, "--mqtt-name", "bench")
    plan = {"rooms": rooms, "rate": RATE, "ramp": max(1.0, rooms / 60)}
    title = f"{rooms} episodes at {RATE:g} steps/s, MQTT {case}"
    if case == WATCHED:
        with watching(broker, token):
            report = load(OURS, bench, title, flags, **plan)
    else:
        report = load(OURS, bench, title, flags, **plan)
    process = report.figures["server process"]
    return float(process["cores used"]) if process else 0.0


def rows(used: dict[str, list[float]]) -> list[Row]:
    """The figures beside their aims."""
    middle = {case: statistics.median(values) for case, values in used.items()}
    step = middle[OFF] / (ROOMS * RATE)
    silent, watched = tap_seconds(watched=False), tap_seconds(watched=True)
    more = middle[WATCHED] - middle[OFF]
    return [
        Row("cores, MQTT off", "", f"{middle[OFF]:.3f}", ""),
        Row("  on, nobody listens", "", f"{middle[SILENT]:.3f}", ""),
        Row(f"  all {ROOMS} episodes watched", "", f"{middle[WATCHED]:.3f}", ""),
        Row("  more for that, of a core", f"{MAX_WATCHED:.0%}", f"{more:.1%}", "",
            met=more <= MAX_WATCHED),
        Row("the tap, a step that nobody watches, µs", "", f"{silent * 1e6:.2f}", ""),
        Row("  … that somebody does", "", f"{watched * 1e6:.2f}", ""),
        Row("  nobody listens, of what a step takes", f"{MAX_SILENT:.0%}", f"{silent / step:.2%}",
            "", met=silent / step <= MAX_SILENT),
    ]  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="to measure, each time")
    parser.add_argument("--turns", type=int, default=2, help="how often each case is measured")
    options = parser.parse_args(arguments)
    console = Console()
    if missing():
        console.print(f"MQTT: {missing()}")
        return
    everyone = tuple(range(os.cpu_count() or 1))
    clients = everyone[1:] or everyone
    bench = Bench(options.seconds, None, everyone[:1], clients, console)
    keep_to_cores(clients if hasattr(os, "sched_setaffinity") else ())
    used: dict[str, list[float]] = {OFF: [], SILENT: [], WATCHED: []}
    with tempfile.TemporaryDirectory() as name, mosquitto(Path(name)) as broker:
        for _ in range(options.turns):
            for case, values in used.items():
                values.append(cores(bench, Path(name), broker, case, ROOMS))
    print_rows(rows(used), console)


if __name__ == "__main__":
    main()
