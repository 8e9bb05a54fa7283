"""Connections that break, and their effect on episodes and messages."""

from __future__ import annotations

import asyncio
import json
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

import pytest

from robotouille.protocol.messages import Create
from robotouille_server import Server
from robotouille_server.mqtt import stream as stream_module
from robotouille_server.mqtt.messages import Presence
from robotouille_server.mqtt.service import (
    MAX_PAUSE,
    MAX_UNSENT,
)
from tests.support.brokers import FakeBroker, role_token, serving_with_broker
from tests.support.operator import Table, table
from tests.support.virtual_time import stand_still, virtual

NAME = "robotouille/v1/lab"


@virtual
async def test_presence_is_retained_until_the_server_stops(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        await asyncio.sleep(1)
        url = server.url
        assert server.metrics.mqtt_connected
    first, last = broker.published[0], broker.published[-1]
    assert (first.topic, first.retain, first.qos) == (f"{NAME}/presence", True, 1)
    presence = Presence.model_validate(first.content)
    assert (presence.state, presence.url, presence.workers) == ("online", url, 1)
    assert (last.topic, last.content, last.retain) == (first.topic, {"state": "stopped"}, True)
    assert not server.metrics.mqtt_connected


def watch(server: Server, broker: FakeBroker, **what: Any) -> None:
    broker.command({"type": "watch", "ref": "w", "token": role_token(server), **what})


@pytest.mark.slow
@virtual
async def test_broker_failures_delay_no_step(tmp_path: Path) -> None:
    # In virtual time, a step is late only if it waited for something.
    async with (
        serving_with_broker(tmp_path) as (server, broker),
        table(server, step_rate=10.0) as play,
    ):
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
        late = server.metrics.lateness.counts
        assert late[0] == sum(late) >= steps > 470


@pytest.mark.parametrize("draining", [False, True])
@virtual
async def test_server_whose_name_was_taken_over_publishes_its_episodes_only(
    tmp_path: Path, draining: bool
) -> None:
    async with (
        serving_with_broker(tmp_path) as (server, broker),
        table(server, max_steps=5000) as play,
    ):
        await asyncio.sleep(1)
        if draining:  # Many brokers do not tell that the name was taken over.
            server.lobby.drain()
            broker.break_off()
        else:
            broker.take_over()
        await asyncio.sleep(5)
        broker.command({"type": "open", "ref": "o", "token": role_token(server)})
        server.lobby.rooms[play.episode].pause()
        await asyncio.sleep(5)
        assert [row["event"] for row in broker.on("life")][-1] == "paused"
        assert server.metrics.mqtt_connected
        rooms = len(server.lobby.rooms)
    assert rooms == 1
    assert broker.attempts == 2
    assert [presence["state"] for presence in broker.on("presence")] == ["online"]
    assert not broker.on("answers")


@pytest.mark.slow
@virtual
async def test_presence_and_queue_are_published_after_reconnecting(tmp_path: Path) -> None:
    async with (
        serving_with_broker(tmp_path) as (server, broker),
        table(server, max_steps=5000) as play,
    ):
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


@pytest.mark.slow
@pytest.mark.parametrize("failure", ["stalled", "breaks_at_steps"])
@virtual
async def test_failing_broker_drops_and_counts_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: str
) -> None:
    monkeypatch.setattr(stream_module, "MAX_STEPS", 20)
    async with (
        serving_with_broker(tmp_path) as (server, broker),
        table(server, step_rate=10.0) as play,
    ):
        watch(server, broker)
        await play.until(lambda game: game.step >= 10)
        setattr(broker, failure, True)
        await play.until(lambda game: game.step >= 300)
        setattr(broker, failure, False)
        await asyncio.sleep(MAX_PAUSE + 10)
        server.lobby.rooms[play.episode].abort("enough")
        await asyncio.sleep(1)
        messages = broker.on("steps")
        rows = [row["step"] for each in messages for row in each["steps"]]
        assert rows == sorted(set(rows))
        dropped = sum(each.get("dropped", 0) for each in messages)
        assert dropped == server.metrics.mqtt_dropped_steps > 100
        last = server.lobby.rooms[play.episode].episode.step
        first = rows[0]
        assert len(rows) + dropped == last - first + 1
        assert server.metrics.mqtt_dropped_messages == 0


@virtual
async def test_lost_connection_does_not_interrupt_a_command(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        await asyncio.sleep(1)
        broker.command({"type": "open", "ref": "o", "token": role_token(server), "count": 20})
        while not server.lobby.rooms:
            await asyncio.sleep(0)
        broker.break_off()
        await asyncio.sleep(5)
        assert len(server.lobby.rooms) == 20
        (answer,) = broker.on("answers")
        assert len(answer["opened"]) == 20


@pytest.mark.slow
@virtual
async def test_stop_publishes_the_queue_that_a_command_waits_for(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        await asyncio.sleep(1)
        broker.stalled = True
        for _ in range(MAX_UNSENT + 50):
            server.lobby.create(Create())
        broker.command({"type": "list", "ref": "l", "token": role_token(server)})
        await asyncio.sleep(0.5)
        broker.stalled = False  # The messages in flight still wait.
        assert not broker.on("answers")
    assert [answer["ref"] for answer in broker.on("answers")] == ["l"]
    assert broker.published[-1].content == {"state": "stopped"}


@virtual
async def test_messages_that_the_broker_does_not_accept_are_dropped_and_counted(
    tmp_path: Path,
) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        broker.largest_packet = 600
        large = server.lobby.create(Create(labels={f"l{n}": "x" * 40 for n in range(12)}))
        small = server.lobby.create(Create())
        await asyncio.sleep(1)
        assert [each["episode"] for each in broker.on("life")] == [small.id]
        assert server.metrics.mqtt_dropped_messages == 1
        broker.break_off()
        broker.largest_packet = inf
        await asyncio.sleep(MAX_PAUSE)
        large.abort("enough")
        await asyncio.sleep(1)
        assert [each["episode"] for each in broker.on("life")] == [small.id, large.id]


async def queue_steps(server: Server, broker: FakeBroker, play: Table, step: int) -> None:
    """Watch an episode, and play it up to a step while the broker is gone."""
    watch(server, broker)
    await asyncio.sleep(1)
    broker.break_off(gone=True)
    await play.until(lambda game: game.step >= step)


@virtual
async def test_steps_are_split_for_brokers_that_accept_small_packets(tmp_path: Path) -> None:
    async with (
        serving_with_broker(tmp_path) as (server, broker),
        table(server, max_steps=5000) as play,
    ):
        await queue_steps(server, broker, play, 100)
        broker.gone, broker.largest_packet = False, 600
        before = len(broker.on("steps"))
        await asyncio.sleep(MAX_PAUSE)
        server.lobby.rooms[play.episode].abort("enough")
        await asyncio.sleep(1)
        messages = broker.on("steps")
        assert max(len(json.dumps(each, separators=(",", ":"))) for each in messages[before:]) < 600
        rows = [row["step"] for each in messages for row in each["steps"]]
        assert rows == [*range(rows[0], rows[-1] + 1)]
        assert rows[-1] >= 100
        assert server.metrics.mqtt_dropped_steps == 0


@virtual
async def test_other_tasks_get_a_turn_after_each_step_that_is_dropped(tmp_path: Path) -> None:
    async with (
        serving_with_broker(tmp_path) as (server, broker),
        table(server, max_steps=5000) as play,
    ):
        await queue_steps(server, broker, play, 60)
        room = server.lobby.rooms[play.episode]
        room.pause()
        queued = room.episode.step - broker.on("steps")[-1]["steps"][-1]["step"]
        broker.gone, broker.largest_packet = False, 100
        dropped = [0]
        async with asyncio.timeout(2 * MAX_PAUSE):
            while dropped[-1] < queued:
                stand_still(0.01)  # Virtual time passes only while no task is ready.
                await asyncio.sleep(0)
                dropped.append(server.metrics.mqtt_dropped_steps)
        assert queued > 20
        assert max(after - before for before, after in pairwise(dropped)) == 1
