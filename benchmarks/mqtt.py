"""Measure the cost of MQTT for a server: off, on without subscribers, and all episodes watched.

The server runs on one core, and the clients and the broker on the others. The three cases are
measured in turns, so that other load on the machine affects all of them.
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

from benchmarks.server import OURS, Bench, Row, load, own_cores, print_rows
from robotouille import World
from robotouille.episode import ActionRequest, Episode, Rules, Stepped
from robotouille_client.loadtest.worker_pool import keep_to_cores
from robotouille_server.auth import Role, Tokens
from robotouille_server.auth.keys import FileKeyring
from robotouille_server.auth.revocation import Revocations
from robotouille_server.mqtt.messages import Topics
from robotouille_server.mqtt.stream import Outbox, RoomStream, Watches
from robotouille_server.runtime.metrics import Metrics

ROOMS, RATE = 200, 5.0
OFF, SILENT, WATCHED = "off", "on, no subscribers", "all watched"
MAX_SILENT, MAX_WATCHED = 0.02, 0.10
CALLS = 100_000


def tap_seconds(*, watched: bool) -> float:
    """Return the seconds that the MQTT tap takes for a step."""
    world = World("multi_agent/01")
    episode = Episode(world, Rules(), 0.0)
    for player in world.players:
        episode.join(player, player, "bot", 0.0)
    for player in world.players:
        episode.submit(player, ActionRequest(1, episode.state.actions(player)[0]), 0.1)
    (step,) = [event for event in episode.events() if isinstance(event, Stepped)]
    room = cast("Any", SimpleNamespace(id="ad9ac0c99d4665c2"))
    watches = Watches(list)
    watches.episodes = {room.id} if watched else set()
    tap = RoomStream(Outbox(Metrics()), watches, Topics("bench"), time.time)
    return min(timeit.repeat(lambda: tap.published(room, [step]), number=CALLS, repeat=5)) / CALLS


async def watch(broker: Mosquitto, token: str) -> None:
    """Watch the steps of all episodes."""
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
    """Run a subscriber that watches all episodes of the next server once it is online."""
    import threading

    thread = threading.Thread(target=lambda: asyncio.run(watch(broker, token)), daemon=True)
    thread.start()
    yield
    thread.join(5)


def cores(bench: Bench, folder: Path, broker: Mosquitto, case: str, rooms: int) -> float:
    """Return the number of cores that a server uses."""
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
    """Return the results with their targets."""
    middle = {case: statistics.median(values) for case, values in used.items()}
    step = middle[OFF] / (ROOMS * RATE)
    silent, watched = tap_seconds(watched=False), tap_seconds(watched=True)
    more = middle[WATCHED] - middle[OFF]
    return [
        Row("cores, MQTT off", "", f"{middle[OFF]:.3f}", ""),
        Row("  on, no subscribers", "", f"{middle[SILENT]:.3f}", ""),
        Row(f"  all {ROOMS} episodes watched", "", f"{middle[WATCHED]:.3f}", ""),
        Row("  increase when watched, of a core", f"{MAX_WATCHED:.0%}", f"{more:.1%}", "",
            met=more <= MAX_WATCHED),
        Row("tap, unwatched step, µs", "", f"{silent * 1e6:.2f}", ""),
        Row("  watched step, µs", "", f"{watched * 1e6:.2f}", ""),
        Row("  unwatched, share of a step's time", f"{MAX_SILENT:.0%}", f"{silent / step:.2%}",
            "", met=silent / step <= MAX_SILENT),
    ]  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="seconds of each measurement")
    parser.add_argument("--turns", type=int, default=2, help="number of measurements of each case")
    options = parser.parse_args(arguments)
    console = Console()
    if missing():
        console.print(f"MQTT: {missing()}")
        return
    everyone = own_cores()
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
