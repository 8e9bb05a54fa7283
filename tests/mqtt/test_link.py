"""What a broker is told of a server's episodes, and what becomes of it where the broker fails: in
virtual time."""

from __future__ import annotations

import asyncio
import random
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.mqtt import outbox as outbox_module
from robotouille_server.mqtt.link import MAX_PAUSE, pauses, steps_interval
from robotouille_server.mqtt.models import EpisodeLife, EpisodeSteps, Presence
from tests.support.brokers import FakeBroker, role_token, told
from tests.support.operator import table
from tests.support.servers import serving
from tests.support.virtual_time import run

NAME = "robotouille/v1/lab"


def watch(server: Server, broker: FakeBroker, **what: Any) -> None:
    broker.command({"type": "watch", "ref": "w", "token": role_token(server), **what})


def test_presence_is_retained_and_ends_with_the_server(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            await asyncio.sleep(1)
            url = server.url
            assert server.metrics.mqtt_connected
        first, last = broker.published[0], broker.published[-1]
        assert (first.topic, first.retain, first.qos) == (f"{NAME}/presence", True, 1)
        presence = Presence.model_validate(first.content)
        assert (presence.state, presence.url, presence.workers) == ("online", url, 1)
        assert (last.topic, last.content, last.retain) == (first.topic, {"state": "stopped"}, True)
        assert not server.metrics.mqtt_connected

    run(main())


def test_the_life_of_an_episode_is_told_with_its_labels(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
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
            lives = [EpisodeLife.model_validate(each) for each in broker.on("life")]
            events = ["opened", "started", "paused", "resumed", "ended"]
            assert [life.event for life in lives] == events
            assert [life.number for life in lives] == [1, 2, 3, 4, 5]
            assert all(life.labels == {"condition": "a"} for life in lives)
            assert lives[2].reasons == ["operator"]
            outcome = room.episode.outcome
            assert outcome is not None
            assert lives[-1].outcome == outcome.to_json()
            assert not broker.on("steps"), "nobody has asked for them"

    run(main())


def test_an_episode_that_nobody_came_to_is_closed(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker), connect(server.url, name="host") as host:
            await host.create("synchronous/01", open_for=60, labels={"pair": "1"})
            await asyncio.sleep(120)
            assert [life["event"] for life in broker.on("life")] == ["opened", "closed"]

    run(main())


def test_episodes_of_a_process_before_are_told_again(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server) as play:
            await play.until(lambda game: game.step >= 1)
            await server.stop(hand_over=True)
        async with told(tmp_path) as (server, broker):
            await asyncio.sleep(1)
            assert [life["event"] for life in broker.on("life")] == ["opened"]
            assert broker.on("life")[0]["step"] >= 1

    run(main())


def test_the_steps_that_were_asked_for_are_those_of_the_recording(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker), table(server) as play:
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
                row
                for each in broker.on("steps")
                for row in EpisodeSteps.model_validate(each).steps
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

    run(main())


def test_a_watch_of_labels_is_for_episodes_to_come_and_ends_in_time(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            watch(server, broker, labels={"study": "s"}, seconds=30)
            await asyncio.sleep(1)
            rules = {"max_steps": 10_000, "step_rate": 2.0}
            async with AsyncExitStack() as stack:
                host = await stack.enter_async_context(
                    connect(server.url, name="host", token=role_token(server, Role.HOST))
                )
                for labels in ({"study": "s", "pair": "1"}, {"study": "t"}):
                    made = await host.create(
                        "synchronous/01", clock="realtime", labels=labels, **rules
                    )
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

    run(main())


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
