"""Lifecycle events, steps, watches and the bounded queue."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.mqtt import stream
from robotouille_server.mqtt.messages import EpisodeSteps, LifecycleEvent
from robotouille_server.mqtt.stream import MAX_WATCHES, Outbox, OutgoingMessage
from robotouille_server.runtime.metrics import Metrics
from tests.support.brokers import FakeBroker, Lab, role_token, serving_with_broker
from tests.support.operator import table
from tests.support.servers import serving
from tests.support.virtual_time import virtual


def test_the_oldest_messages_are_dropped_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MAX_MESSAGES", 3)
    metrics = Metrics()
    outbox = Outbox(metrics)
    for number in range(5):
        outbox.add(OutgoingMessage(str(number), b"{}"))
    assert [message.topic for message in outbox.messages] == ["2", "3", "4"]
    assert metrics.mqtt_dropped_messages == 2


NAME = "robotouille/v1/lab"


def watch(server: Server, broker: FakeBroker, **what: Any) -> None:
    broker.command({"type": "watch", "ref": "w", "token": role_token(server), **what})


@virtual
async def test_lifecycle_events_have_labels(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        async with table(server, labels={"condition": "a"}) as play:
            await play.until(lambda game: game.step >= 2)
            room = server.lobby.rooms[play.episode]
            room.pause()
            room.resume()
            room.abort("enough")
            await asyncio.sleep(1)
        (topic,) = {each.topic for each in broker.published if each.topic.endswith("life")}
        assert topic == f"{NAME}/episodes/{play.episode}/life"
        assert play.code not in str(broker.published)
        lives = [LifecycleEvent.model_validate(each) for each in broker.on("life")]
        events = ["opened", "started", "paused", "resumed", "ended"]
        assert [life.event for life in lives] == events
        assert [life.number for life in lives] == [1, 2, 3, 4, 5]
        assert all(life.labels == {"condition": "a"} for life in lives)
        assert lives[2].reasons == ["operator"]
        outcome = room.episode.outcome
        assert outcome is not None
        assert lives[-1].outcome == outcome.to_json()
        assert not broker.on("steps"), "no watch was requested"


@virtual
async def test_episode_without_participants_is_closed(tmp_path: Path) -> None:
    async with (
        serving_with_broker(tmp_path) as (server, broker),
        connect(server.url, name="host") as host,
    ):
        await host.create("synchronous/01", open_for=60, labels={"pair": "1"})
        await asyncio.sleep(120)
        assert [life["event"] for life in broker.on("life")] == ["opened", "closed"]


@virtual
async def test_restored_episodes_are_opened_again(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, table(server) as play:
        await play.until(lambda game: game.step >= 1)
        await server.stop(hand_over=True)
    async with serving_with_broker(tmp_path) as (server, broker):
        await asyncio.sleep(1)
        assert [life["event"] for life in broker.on("life")] == ["opened"]
        assert broker.on("life")[0]["step"] >= 1


@virtual
async def test_steps_of_a_watch_equal_the_recording(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker), table(server) as play:
        watch(server, broker, episode=play.episode)
        await asyncio.sleep(1)
        begun = play.games[0].step
        for _ in range(4):
            await play.until(lambda game: game.actions)
            await play.games[0].act(play.games[0].actions[0])
        await play.until(lambda game: game.step > begun + 8)
        room = server.lobby.rooms[play.episode]
        room.abort("enough")
        await asyncio.sleep(1)
        await server.lobby.closed()
        steps = [
            row for each in broker.on("steps") for row in EpisodeSteps.model_validate(each).steps
        ]
        recorded = read_recording(tmp_path / room.recording)
        frames = [f for f in recorded.frames if f["kind"] == "step"][-len(steps) :]
        assert len(steps) > 8
        assert [s.step for s in steps] == list(range(steps[0].step, frames[-1]["step"] + 1))
        assert sum(len(s.moves) for s in steps) >= 3
        for step, frame in zip(steps, frames, strict=True):
            assert (step.step, step.t) == (frame["step"], frame["t"])
            assert [(m.player, m.action, m.ms) for m in step.moves] == [
                (m["player"], m["action"], m["ms"]) for m in frame["moves"]
            ]
            refused = [str(i) for i, m in enumerate(step.moves) if not m.applied]
            assert refused == list(frame.get("unmet", {}))
        assert not any(each.qos for each in broker.published if "steps" in each.topic)


@virtual
async def test_watch_of_labels_includes_later_episodes_until_it_expires(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        watch(server, broker, labels={"study": "s"}, seconds=30)
        await asyncio.sleep(1)
        rules = {"max_steps": 10_000, "step_rate": 2.0}
        async with AsyncExitStack() as stack:
            host = await stack.enter_async_context(
                connect(server.url, name="host", token=role_token(server, Role.HOST))
            )
            for labels in ({"study": "s", "pair": "1"}, {"study": "t"}):
                made = await host.create("synchronous/01", clock="realtime", labels=labels, **rules)
                client = await stack.enter_async_context(connect(server.url, name="x"))
                await client.join(made.code)
            await asyncio.sleep(20)
            (watched,) = {each["episode"] for each in broker.on("steps")}
            room = server.lobby.rooms[watched]
            assert room.labels["study"] == "s"
            await asyncio.sleep(30)
            count = len(broker.on("steps"))
            step = room.episode.step
            await asyncio.sleep(30)
            assert room.episode.step > step
            assert len(broker.on("steps")) == count


@virtual
async def test_watches_are_limited_replaced_and_ended(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        for number in range(MAX_WATCHES):
            assert (await lab.ask("watch", labels={"pair": str(number)})).ok
        assert await lab.refused("watch", labels={"pair": "x"}) == "rate/limited"
        assert (await lab.ask("watch", labels={"pair": "1"})).ok
        assert (await lab.ask("unwatch", labels={"pair": "1"})).done == "1 watches ended"
        both = {"episode": "a", "labels": {"pair": "2"}}
        assert await lab.refused("watch", **both) == "message/invalid-field"
        assert (await lab.ask("unwatch", episode="gone")).done == "0 watches ended"
        assert (await lab.ask("unwatch")).done == f"{MAX_WATCHES - 1} watches ended"
