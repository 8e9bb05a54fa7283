"""What the operator is shown is what goes on."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from robotouille.episode import Activity
from robotouille_client import connect
from robotouille_server import Server
from tests.support.operator import Disk, table, viewing
from tests.support.servers import raw
from tests.support.virtual_time import run


def test_an_episode_with_everything_about_it(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


def test_who_is_away_and_for_how_long_they_are_waited_for(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


def _drop(server: Server, name: str) -> None:
    """The line of a participant is cut and does not come back by itself for a while."""
    for session in server.sessions.by_id.values():
        if session.name == name and session.peer is not None:
            session.peer.drop("cut")


def test_latency_is_the_connections_round_trip(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:
            sessions = {session.name: session for session in server.sessions.by_id.values()}
            assert sessions["ada"].peer is not None
            sessions["ada"].peer.socket.latency = 0.0123
            seats = (await api.row(play.episode))["seats"]
            assert [seat["latency_ms"] for seat in seats] == [12.3, None]

    run(main())


def test_addresses_are_shown_only_where_the_server_keeps_them(tmp_path: Path) -> None:
    async def addresses(folder: Path, keep: bool) -> list[Any]:
        async with viewing(folder, record_addresses=keep) as (server, _, api):
            async with table(server) as play:
                return [seat["address"] for seat in (await api.row(play.episode))["seats"]]

    assert run(addresses(tmp_path / "no", False)) == [None, None]
    assert run(addresses(tmp_path / "yes", True)) == ["127.0.0.1", "127.0.0.1"]


def test_totals_are_those_of_the_last_seconds(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server, step_rate=10) as play:
            await asyncio.sleep(8)
            await play.until(lambda game: game.step >= 60)
            totals = (await api.get("/api/overview"))["totals"]
            assert totals["connections"] == 2
            assert totals["episodes"] == {"waiting": 0, "running": 1, "paused": 0, "over": 0}
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

    run(main())


def test_errors_are_counted_by_their_code(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), raw(server) as connection:
            await connection.ask({"type": "join", "episode": "NOSUCHCODE"}, "error")
            await connection.ask({"type": "zap"}, "error")
            await connection.ask({"type": "zap"}, "error")
            errors = (await api.get("/api/overview"))["totals"]["errors"]
            assert errors == {"message/unknown-type": 2, "episode/unknown": 1}

    run(main())


def test_a_full_disk_is_shown_first_and_gone_when_there_is_room_again(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


def test_episodes_are_found_by_phase_and_words_and_shown_in_parts(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:
            async with connect(server.url, name="host") as host:
                waiting = [(await host.create("asynchronous/06")).episode for _ in range(3)]

            async def found(**asked: Any) -> list[str]:
                seen = await api.get("/api/overview", params=asked)
                return [row["episode"] for row in seen["episodes"]]

            assert await found() == [play.episode, *waiting[::-1]]
            assert await found(phase="running") == [play.episode]
            assert await found(phase="over") == []
            assert await found(search="ADA") == [play.episode]
            assert await found(search="potato soup") == waiting[::-1]
            assert await found(search=play.code) == [play.episode]
            assert await found(limit=2, offset=1) == [waiting[2], waiting[1]]
            assert (await api.get("/api/overview", params={"limit": 1}))["found"] == 4

    run(main())


def test_one_episode_can_be_watched_in_words(tmp_path: Path) -> None:
    async def main() -> None:
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
            lines = [(line["kind"], line["who"], line["text"]) for line in seen["lines"]]
            assert ("say", "ada", "Hello there") in lines
            assert ("seat", "robot2", "bob is here (human)") in lines
            assert ("note", "", "everybody is there, the game begins") in lines
            assert ("act", "robot1", action.sentence) in lines
            for seat, played in zip(seen["seats"], room.episode.seats.values(), strict=True):
                counts = [seat[each.value] for each in Activity]
                assert counts == [getattr(played.tally, each.value) for each in Activity]
                assert sum(counts) == seen["step"] >= 6

    run(main())


def test_a_stream_tells_what_changes(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:
            events = api.events(f"/api/episodes/{play.code}/events")
            first = await anext(events)
            later = await anext(events)
            assert later["step"] > first["step"]
            await events.aclose()  # type: ignore[attr-defined]
            overviews = api.events("/api/overview/events?search=ada")
            assert [(await anext(overviews))["found"], (await anext(overviews))["found"]] == [1, 1]
            await overviews.aclose()  # type: ignore[attr-defined]

    run(main())


def test_spectators_are_named(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (server, _, api), table(server) as play:
            async with connect(server.url, name="eve") as eve:
                await eve.join(play.code, role="spectator")
                seen = await api.get(f"/api/episodes/{play.code}")
                assert [row["name"] for row in seen["audience"]] == ["eve"]
                assert seen["spectators"] == 1

    run(main())
