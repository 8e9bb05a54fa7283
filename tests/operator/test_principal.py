"""Operator tokens that are limited to one episode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.support.operator import CHANGE, Api, bearer, table, viewing
from tests.support.virtual_time import virtual

ACTIONS: dict[str, dict[str, str]] = {
    "pause": {},
    "resume": {},
    "end": {},
    "announce": {"text": "x"},
    "kick": {"session": "x"},
}


async def refused(api: Api, path: str, body: Any = None) -> tuple[int, str]:
    if body is None:
        answer = await api.http.get(path)
    else:
        answer = await api.http.post(path, json=body, headers=CHANGE)
    return answer.status_code, answer.json().get("code", "")


@pytest.mark.parametrize("named_by", ["episode", "code"])
@virtual
async def test_token_shows_and_controls_only_its_episode(tmp_path: Path, named_by: str) -> None:
    async with viewing(tmp_path, tokens=True) as (server, _, api):
        async with table(server) as mine, table(server) as other:
            api.http.headers.update(bearer(server, episode=getattr(mine, named_by)))
            seen = await api.get("/api/overview")
            assert [row["episode"] for row in seen["episodes"]] == [mine.episode]
            assert (seen["found"], seen["totals"]["episodes"]["running"]) == (1, 1)
            assert seen["server"]["only"] == getattr(mine, named_by)
            await api.do(f"/api/episodes/{mine.code}/announce", text="only here")
            await mine.until(lambda game: game.step >= 1)
            for name in (other.episode, other.code, "NOSUCHCODE"):
                for what, body in ACTIONS.items():
                    path = f"/api/episodes/{name}/{what}"
                    assert await refused(api, path, body) == (403, "auth/episode")
                for path in (f"/api/episodes/{name}", f"/api/episodes/{name}/events"):
                    assert await refused(api, path) == (403, "auth/episode")
            to_all = await refused(api, "/api/announce", {"text": "to all"})
            assert to_all == (403, "auth/episode")
            assert server.lobby.rooms[other.episode].episode.step > 0


@virtual
async def test_token_gives_access_only_to_its_recording(tmp_path: Path) -> None:
    async with viewing(tmp_path, tokens=True) as (server, _, api):
        async with (
            table(server) as mine,
            table(server, names=("ada", f"_{mine.episode}.rbt")) as other,
        ):
            await mine.until(lambda game: game.step >= 2)
            await other.until(lambda game: game.step >= 2)
            names = {name.rpartition("_")[2]: name for name in server.storage.names()}  # type: ignore[union-attr]
            hers, others = (names[f"{one.episode}.rbt.part"] for one in (mine, other))
            api.http.headers.update(bearer(server, episode=mine.code))
            listed = await api.get("/api/recordings")
            assert [row["name"] for row in listed["recordings"]] == [hers]
            for search, found in (("ada", 1), (other.code, 0), (f"_{mine.episode}.rbt", 1)):
                answer = await api.get("/api/recordings", params={"search": search})
                assert answer["found"] == found, search
            assert (await api.http.get(f"/api/recordings/{hers}")).status_code == 200
            for name in (others, others.removesuffix(".part"), "nothing.rbt"):
                path = f"/api/recordings/{name}"
                assert await refused(api, path) == (403, "auth/episode")


@virtual
async def test_problems_of_other_episodes_are_hidden(tmp_path: Path) -> None:
    (tmp_path / "x_y_0000000000000000.rbt.part").write_bytes(b"damaged")
    async with viewing(tmp_path, tokens=True) as (server, _, api):
        async with table(server) as mine:
            api.http.headers.update(bearer(server, episode=mine.episode))
            seen = await api.get("/api/overview")
            assert (seen["faults"], seen["alerts"]) == ([], [])
            api.http.headers.update(bearer(server))
            assert len((await api.get("/api/overview"))["faults"]) == 1


@virtual
async def test_optional_token_is_checked_and_applied(tmp_path: Path) -> None:
    async with viewing(tmp_path, tokens=True, view={"ask_token": False}) as (server, _, api):
        async with table(server) as mine, table(server):
            assert (await api.get("/api/overview"))["found"] == 2
            mine_only = bearer(server, episode=mine.episode)
            assert (await api.get("/api/overview", headers=mine_only))["found"] == 1
            guess = {"Authorization": "Bearer guess"}
            answer = await api.http.get("/api/overview", headers=guess)
            assert (answer.status_code, answer.json()["code"]) == (401, "auth/invalid")
