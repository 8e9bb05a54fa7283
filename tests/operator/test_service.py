"""Effects of the operator API on running episodes."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille_client import Announced, GameEnded, connect
from tests.support.operator import table, viewing
from tests.support.virtual_time import virtual


@virtual
async def test_pause_stops_the_episode_until_resume(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        await play.until(lambda game: game.step >= 2)
        await api.do(f"/api/episodes/{play.episode}/pause")
        for seat in (0, 1):
            await play.until(lambda game: game.phase == "paused", seat)
            pause = play.games[seat].pause
            assert pause is not None
            assert (pause.reason, pause.left) == ("operator", None)
        step = server.lobby.rooms[play.episode].episode.step
        await asyncio.sleep(120)
        assert server.lobby.rooms[play.episode].episode.step == step
        assert (await api.row(play.episode))["pause"] == {"reason": "operator", "left": None}
        await api.do(f"/api/episodes/{play.code}/resume")
        await play.until(lambda game: game.step > step)
        assert play.games[0].phase == "running"


@virtual
async def test_end_sends_and_records_the_reason(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        await play.until(lambda game: game.step >= 1)
        await api.do(f"/api/episodes/{play.episode}/end", reason="the hour is over")
        for seat in (0, 1):
            await play.until(lambda game: game.outcome, seat)
            outcome = play.games[seat].outcome
            assert outcome is not None
            assert (outcome["reason"], outcome["detail"]) == ("aborted", "the hour is over")
        await server.lobby.closed()
        row = (await api.get("/api/recordings"))["recordings"][0]
        assert (row["outcome"], row["name"].endswith(".rbt")) == ("aborted", True)
        for what in ("pause", "resume", "end"):
            answer = await api.post(f"/api/episodes/{play.episode}/{what}")
            assert (answer.status_code, answer.json()["code"]) == (409, "episode/ended")


@virtual
async def test_removed_player_loses_the_seat_and_gets_the_reason(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        seats = (await api.row(play.episode))["seats"]
        path = f"/api/episodes/{play.episode}/kick"
        await api.do(path, session=seats[1]["session"], reason="be kind")
        over = await play.wait_for(GameEnded, seat=1)
        assert over.reason == "be kind"
        seats = (await api.row(play.episode))["seats"]
        assert [seat["name"] for seat in seats] == ["ada", ""]
        assert seats[1]["session"] is None


@virtual
async def test_spectator_can_be_removed(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        async with connect(server.url, name="eve") as eve:
            game = await eve.join(play.code, role="spectator")
            seen = await api.get(f"/api/episodes/{play.episode}")
            (audience,) = seen["audience"]
            path = f"/api/episodes/{play.episode}/kick"
            await api.do(path, session=audience["session"])
            while not isinstance(event := await game.next_event(), GameEnded):
                pass
            assert event.reason == "removed by the operator"
            assert (await api.get(f"/api/episodes/{play.episode}"))["audience"] == []
            answer = await api.post(path, session=audience["session"])
            assert (answer.status_code, answer.json()["code"]) == (404, "session/unknown")


@virtual
async def test_announcement_reaches_one_episode_or_all(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api):
        async with table(server) as here, table(server) as there:
            await api.do(f"/api/episodes/{here.episode}/announce", text="  only\u202e here ")
            await api.do("/api/announce", text="to all")
            assert [(await here.wait_for(Announced)).text for _ in range(2)] == [
                "only here",
                "to all",
            ]
            assert (await there.wait_for(Announced)).text == "to all"
            lines = (await api.get(f"/api/episodes/{here.episode}"))["lines"]
            said = [line["text"] for line in lines if line["who"] == "operator"]
            assert said == ["only here", "to all"]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({}, "text"),
        ({"text": ""}, "text"),
        ({"text": "   "}, "text"),
        ({"text": "\u200b"}, "text"),
        ({"text": "x" * 501}, "500"),
        ({"text": 7}, "text"),
        ({"text": "x", "loud": True}, "loud"),
    ],
)
@virtual
async def test_invalid_body_is_refused_with_the_field(
    tmp_path: Path, body: dict[str, object], words: str
) -> None:
    async with viewing(tmp_path) as (_, _, api):
        answer = await api.post("/api/announce", **body)
        assert (answer.status_code, answer.json()["code"]) == (400, "request/invalid")
        assert words in answer.json()["message"]


@virtual
async def test_unreadable_body_is_invalid(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        headers = {"content-type": "application/json", "x-robotouille-operator": "1"}
        answer = await api.http.post("/api/announce", content="[" * 16_000, headers=headers)
        assert (answer.status_code, answer.json()["code"]) == (400, "request/invalid")


@virtual
async def test_unknown_episode_path_or_method_is_refused(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        for what in ("pause", "resume", "end", "announce", "kick"):
            body = {"announce": {"text": "x"}, "kick": {"session": "x"}}.get(what, {})
            answer = await api.post(f"/api/episodes/NOSUCHCODE/{what}", **body)
            assert (answer.status_code, answer.json()["code"]) == (404, "episode/unknown")
            assert "NOSUCHCODE" in answer.json()["message"]
        answer = await api.http.get("/api/episodes/NOSUCHCODE/events")
        assert answer.status_code == 404
        answer = await api.http.get("/api/nothing")
        assert (answer.status_code, answer.json()["code"]) == (404, "request/unknown")
        answer = await api.http.get("/api/announce")
        assert (answer.status_code, answer.json()["code"]) == (405, "request/method")


@virtual
async def test_overview_shows_that_the_server_drains(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        await play.until(lambda game: game.step >= 1)
        before = await api.get("/api/overview")
        draining = asyncio.create_task(server.drain(5.0))
        await asyncio.sleep(1)
        during = await api.get("/api/overview")
        assert not before["server"]["draining"]
        assert during["server"]["draining"]
        assert during["server"]["url"] == before["server"]["url"]
        assert [row["episode"] for row in during["episodes"]] == [play.episode]
        await draining
