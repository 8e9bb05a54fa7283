"""What a broker is told of the life of episodes, and their steps: in virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.mqtt.models import EpisodeLife, EpisodeSteps
from tests.support.brokers import FakeBroker, role_token, told
from tests.support.operator import table
from tests.support.servers import serving
from tests.support.virtual_time import run

NAME = "robotouille/v1/lab"


def watch(server: Server, broker: FakeBroker, **what: Any) -> None:
    broker.command({"type": "watch", "ref": "w", "token": role_token(server), **what})


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
