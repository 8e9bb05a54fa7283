"""Overview and detail rows of the operator API, and their rates."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from robotouille.episode import Activity
from robotouille.protocol.states import StateReader
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.operator.rows import MetricsHistory
from robotouille_server.runtime.metrics import Metrics
from tests.support.operator import Disk, table, viewing
from tests.support.servers import raw
from tests.support.virtual_time import run, virtual


@virtual
async def test_row_describes_the_episode(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server, step_rate=5) as play:
        await play.until(lambda game: game.step >= 3)
        row = await api.row(play.episode)
        assert row["task"] == "multi_agent/01_lettuce_burger"
        assert row["code"].replace("-", "") == play.code.replace("-", "")
        assert (row["clock"], row["step_rate"]) == ("realtime", 5.0)
        assert (row["phase"], row["pause"], row["outcome"]) == ("running", None, None)
        assert row["step"] >= 3
        assert row["max_steps"] == 900  # Three minutes, as people play.
        assert [seat["name"] for seat in row["seats"]] == ["ada", "bob"]
        assert {seat["controller"] for seat in row["seats"]} == {"human"}
        assert all(seat["present"] and seat["address"] is None for seat in row["seats"])
        name = row["recording"]["name"]
        assert (tmp_path / name).stat().st_size >= row["recording"]["size"] > 0
        assert row["watch"] == f"robotouille-client {row['code']} --watch --url {server.url}"


@virtual
async def test_row_shows_absent_players_and_the_remaining_pause(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api):
        async with table(server, absence="pause", grace=60) as play:
            await play.until(lambda game: game.step >= 1)
            _drop(server, "bob")
            await play.until(lambda game: game.pause)
            row = await api.row(play.episode)
            assert row["phase"] == "paused"
            assert row["pause"]["reason"] == "absence"
            assert 0 < row["pause"]["left"] <= 60
            assert [s["controller"] for s in row["seats"]] == ["human", "absent"]


def _drop(server: Server, name: str) -> None:
    """Close the connection of a participant, who does not reconnect for a while."""
    for session in server.sessions.by_id.values():
        if session.name == name and session.peer is not None:
            session.peer.drop("cut")


@virtual
async def test_latency_is_the_round_trip_of_the_connection(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        sessions = {session.name: session for session in server.sessions.by_id.values()}
        assert sessions["ada"].peer is not None
        sessions["ada"].peer.socket.latency = 0.0123
        seats = (await api.row(play.episode))["seats"]
        assert [seat["latency_ms"] for seat in seats] == [12.3, None]


def test_addresses_are_shown_only_if_the_server_stores_them(tmp_path: Path) -> None:
    async def addresses(folder: Path, keep: bool) -> list[Any]:
        async with viewing(folder, record_addresses=keep) as (server, _, api):
            async with table(server) as play:
                return [seat["address"] for seat in (await api.row(play.episode))["seats"]]

    assert run(addresses(tmp_path / "no", False)) == [None, None]
    assert run(addresses(tmp_path / "yes", True)) == ["127.0.0.1", "127.0.0.1"]


@virtual
async def test_totals_cover_the_last_seconds(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server, step_rate=10) as play:
        await asyncio.sleep(8)
        await play.until(lambda game: game.step >= 60)
        totals = (await api.get("/api/overview"))["totals"]
        assert totals["connections"] == 2
        assert totals["episodes"] == {"waiting": 0, "running": 1, "paused": 0, "ended": 0}
        assert 8 <= totals["steps_per_second"] <= 12
        assert totals["sent_bytes_per_second"] > 0
        assert totals["lateness"]["steps"] >= 50
        assert totals["lateness"]["p50"] is not None
        assert len(totals["history"]["steps"]) >= 7
        row = await api.row(play.episode)
        assert row["rates"] == {"received": None, "sent": None}
        await asyncio.sleep(2)
        row = await api.row(play.episode)
        assert 15 <= row["rates"]["sent"] <= 25


@virtual
async def test_errors_are_counted_by_code(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), raw(server) as connection:
        await connection.ask({"type": "join", "episode": "NOSUCHCODE"}, "error")
        await connection.ask({"type": "zap"}, "error")
        await connection.ask({"type": "zap"}, "error")
        errors = (await api.get("/api/overview"))["totals"]["errors"]
        assert errors == {"message/unknown-type": 2, "episode/unknown": 1}


@virtual
async def test_full_disk_is_shown_first_until_there_is_space(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    async with viewing(tmp_path, storage=disk) as (server, _, api):
        async with table(server) as troubled, table(server) as other:
            await troubled.until(lambda game: game.step >= 1)
            disk.full = True
            await other.until(lambda game: game.pause)
            seen = await api.get("/api/overview")
            text = "the recording cannot be written: No space left on device"
            (fault,) = seen["faults"]
            assert (fault["text"], fault["episodes"]) == (text, 2)
            assert fault["episode"] in (troubled.episode, other.episode)
            row = seen["episodes"][0]
            assert row["problem"] == row["recording"]["problem"] == text
            assert (row["phase"], row["pause"]["reason"]) == ("paused", "storage")
            disk.full = False
            await other.until(lambda game: not game.pause)
            assert (await api.get("/api/overview"))["faults"] == []


@virtual
async def test_episodes_are_filtered_and_paged(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        async with connect(server.url, name="host") as host:
            waiting = [(await host.create("asynchronous/06")).episode for _ in range(3)]

        async def found(**query: Any) -> list[str]:
            seen = await api.get("/api/overview", params=query)
            return [row["episode"] for row in seen["episodes"]]

        assert await found() == [play.episode, *waiting[::-1]]
        assert await found(phase="running") == [play.episode]
        assert await found(phase="ended") == []
        # Ids are hexadecimal, so some contain "ada".
        assert await found(search="BOB") == [play.episode]
        assert await found(search="potato soup") == waiting[::-1]
        assert await found(search=play.code) == [play.episode]
        assert await found(limit=2, offset=1) == [waiting[2], waiting[1]]
        assert (await api.get("/api/overview", params={"limit": 1}))["found"] == 4


@virtual
async def test_detail_shows_state_and_events_as_text(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        game = play.games[0]
        action = game.state.actions("robot1")[0]
        assert (await game.act(action)).applied
        game.say("Hello there")
        await play.until(lambda g: g.step >= 6)
        room = server.lobby.rooms[play.episode]
        room.pause()
        seen = await api.get(f"/api/episodes/{play.episode}")
        assert seen["text"] == room.episode.state.text(None)
        tables = await api.get(f"/api/episodes/{play.episode}/kitchen")
        assert tables["size"] == seen["state"]["size"]
        assert tables["look"] == {"rendering": None, "bindings": None, "pictures": {}}
        assert tables["task"]["problem"]["width"] == room.world.task.problem.width
        read = StateReader(room.world, tables, seen["state"])
        assert read.state == room.episode.state
        lines = [(line["kind"], line["who"], line["text"]) for line in seen["lines"]]
        assert ("say", "ada", "Hello there") in lines
        assert ("seat", "robot2", "bob is here (human)") in lines
        assert ("note", "", "everyone is ready, the game begins") in lines
        assert ("act", "robot1", action.sentence) in lines
        for seat, played in zip(seen["seats"], room.episode.seats.values(), strict=True):
            counts = [seat[each.value] for each in Activity]
            assert counts == [getattr(played.tally, each.value) for each in Activity]
            assert sum(counts) == seen["step"] >= 6


@virtual
async def test_stream_sends_changes(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        events = api.events(f"/api/episodes/{play.code}/events")
        first = await anext(events)
        later = await anext(events)
        assert later["step"] > first["step"]
        await events.aclose()  # type: ignore[attr-defined]
        overviews = api.events("/api/overview/events?search=ada")
        assert [(await anext(overviews))["found"], (await anext(overviews))["found"]] == [1, 1]
        await overviews.aclose()  # type: ignore[attr-defined]


@virtual
async def test_detail_lists_spectators(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        async with connect(server.url, name="eve") as eve:
            await eve.join(play.code, role="spectator")
            seen = await api.get(f"/api/episodes/{play.code}")
            assert [row["name"] for row in seen["audience"]] == ["eve"]
            assert seen["spectators"] == 1


def test_percentiles_are_bucket_bounds_of_the_last_minute() -> None:
    metrics = Metrics()
    history = MetricsHistory(metrics)
    for _ in range(1000):
        metrics.lateness.observe(5.0)
    history.sample(0.0)
    for late, count in [(0.0004, 600), (0.004, 395), (0.03, 5)]:
        for _ in range(count):
            metrics.lateness.observe(late)
    history.sample(1.0)
    seen = history.lateness()
    assert (seen.steps, seen.p50, seen.p99, seen.p999) == (1000, 0.5, 5.0, 50.0)
    metrics.lateness.observe(9.0)
    history.sample(2.0)
    assert history.lateness().p999 == 50.0
    for _ in range(10):
        metrics.lateness.observe(9.0)
    history.sample(3.0)
    assert history.lateness().p999 is None
