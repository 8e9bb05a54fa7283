"""What a broker is told of a server's episodes, and what becomes of it where the broker fails: in
virtual time."""

from __future__ import annotations

import asyncio
import random
from pathlib import Path
from typing import Any

import pytest

from robotouille_server import Server
from robotouille_server.mqtt import outbox as outbox_module
from robotouille_server.mqtt.link import MAX_PAUSE, pauses, steps_interval
from tests.support.brokers import FakeBroker, role_token, told
from tests.support.operator import table
from tests.support.virtual_time import run

NAME = "robotouille/v1/lab"


def watch(server: Server, broker: FakeBroker, **what: Any) -> None:
    broker.command({"type": "watch", "ref": "w", "token": role_token(server), **what})


def lateness(server: Server) -> list[int]:
    return server.metrics.lateness.counts


def test_whatever_the_broker_does_no_step_is_later_for_it(tmp_path: Path) -> None:
    """In virtual time a step is late only if somebody waits."""

    async def main() -> None:
        async with told(tmp_path) as (server, broker), table(server, step_rate=10.0) as play:
            watch(server, broker)
            await play.until(lambda game: game.step >= 10)
            broker.stalled = True
            await play.until(lambda game: game.step >= 200)
            broker.break_off(gone=True)
            await play.until(lambda game: game.step >= 300)
            for _ in range(5):
                broker.gone = broker.stalled = False
                await asyncio.sleep(1)
                broker.break_off()
            await play.until(lambda game: game.step >= 480)
            steps = server.lobby.rooms[play.episode].episode.step
            assert lateness(server)[0] == sum(lateness(server)) >= steps > 470

    run(main())


def test_after_it_was_gone_presence_and_what_waited_are_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker), table(server, max_steps=5000) as play:
            await asyncio.sleep(1)
            broker.break_off(gone=True)
            await asyncio.sleep(60)
            before, attempts = len(broker.published), broker.attempts
            assert 5 < attempts < 15
            server.lobby.rooms[play.episode].pause()
            server.lobby.rooms[play.episode].resume()
            await asyncio.sleep(60)
            broker.gone = False
            await asyncio.sleep(MAX_PAUSE)
            again = broker.published[before:]
            assert again[0].topic == f"{NAME}/presence"
            assert again[0].content["state"] == "online"
            assert [each.content["event"] for each in again[1:]] == ["paused", "resumed"]

    run(main())


def test_a_stalled_broker_costs_bounded_memory_and_dropped_steps_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox_module, "MAX_STEPS", 20)

    async def main() -> None:
        async with told(tmp_path) as (server, broker), table(server, step_rate=10.0) as play:
            watch(server, broker)
            await play.until(lambda game: game.step >= 10)
            broker.stalled = True
            await play.until(lambda game: game.step >= 300)
            broker.stalled = False
            await asyncio.sleep(MAX_PAUSE + 10)
            server.lobby.rooms[play.episode].abort("enough")
            await asyncio.sleep(1)
            told_of = broker.on("steps")
            rows = [row["step"] for each in told_of for row in each["steps"]]
            assert rows == sorted(set(rows))
            dropped = sum(each.get("dropped", 0) for each in told_of)
            assert dropped == server.metrics.mqtt_dropped_steps > 100
            last = server.lobby.rooms[play.episode].episode.step
            first = rows[0]
            assert len(rows) + dropped == last - first + 1
            assert server.metrics.mqtt_dropped_messages == 0

    run(main())


def test_pauses_double_are_drawn_at_random_and_bounded() -> None:
    drawn = pauses(random.Random(1))
    found = [next(drawn) for _ in range(12)]
    assert 0.25 <= found[0] <= 0.5
    assert all(MAX_PAUSE / 2 <= pause <= MAX_PAUSE for pause in found[8:])
    assert len(set(found)) == 12


def test_where_many_are_watched_each_message_has_more_steps() -> None:
    assert steps_interval(0) == steps_interval(20) == 0.2
    assert steps_interval(200) == 2.0


def test_a_command_is_carried_out_whole_though_the_connection_breaks(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            await asyncio.sleep(1)
            broker.command({"type": "open", "ref": "o", "token": role_token(server), "count": 20})
            while not server.lobby.rooms:
                await asyncio.sleep(0)
            broker.break_off()
            await asyncio.sleep(5)
            assert len(server.lobby.rooms) == 20
            (answer,) = broker.on("answers")
            assert len(answer["opened"]) == 20

    run(main())
