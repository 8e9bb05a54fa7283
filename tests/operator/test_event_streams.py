"""A stream lasts no longer than the token it was opened with."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille_server import Server
from robotouille_server.admin.http.event_streams import MAX_STREAMS, MAX_STREAMS_PER_SUBJECT
from robotouille_server.auth.keys import rotate
from tests.support.operator import Api, bearer, table, viewing
from tests.support.virtual_time import VirtualTimeLoop, run


def wall() -> float:
    """A clock on the wall that goes with the loop's."""
    try:
        loop = asyncio.get_running_loop()
    except RuntimeError:
        return 1_800_000_000.0
    assert isinstance(loop, VirtualTimeLoop)
    return 1_800_000_000.0 + loop.time()


async def last_event(lines: Any) -> Any:
    """The event that a stream ends with, as its kind and its data."""
    async with asyncio.timeout(60):
        kept = [line async for line in lines if line]
    assert kept[-2].startswith("event: "), kept[-3:]
    return kept[-2].removeprefix("event: "), json.loads(kept[-1].removeprefix("data: "))


async def opened(api: Api, path: str, headers: dict[str, str]) -> httpx.Response:
    request = api.http.build_request("GET", path, headers=headers)
    return await api.http.send(request, stream=True)


def expire(server: Server, keys: Path) -> None:
    """Time does it."""


def rotate_away(server: Server, keys: Path) -> None:
    rotate(keys, keep=1)


@pytest.mark.parametrize(
    ("what", "code", "seconds", "within"),
    [(expire, "auth/expired", 30, 32), (rotate_away, "auth/invalid", 3600, 3)],
)
def test_a_stream_ends_with_its_token_and_says_why(
    tmp_path: Path, what: Callable[[Server, Path], None], code: str, seconds: float, within: float
) -> None:
    keys = tmp_path / "state" / "keys.json"

    async def main() -> None:
        options: dict[str, Any] = {"tokens": True, "wall": wall, "keys": keys}
        async with viewing(tmp_path / "r", **options) as (server, _, api):
            async with table(server) as play:
                headers = bearer(server, seconds=seconds)
                paths = ("/api/overview/events", f"/api/episodes/{play.episode}/events")
                streams = [await opened(api, path, headers) for path in paths]
                lines = [stream.aiter_lines() for stream in streams]
                for one in lines:
                    assert (await anext(one)).startswith("data: ")
                begun = asyncio.get_running_loop().time()
                what(server, keys)
                for one in lines:
                    kind, problem = await last_event(one)
                    assert (kind, problem["code"]) == ("refused", code)
                assert asyncio.get_running_loop().time() - begun < within

    run(main())


def test_who_has_a_token_gets_a_stream_however_many_are_open_without(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path, tokens=True, view={"ask_token": False}) as (server, _, api):
            path = "/api/overview/events"
            streams = [await opened(api, path, {}) for _ in range(MAX_STREAMS)]
            lines = [stream.aiter_lines() for stream in streams]
            for one in lines:
                await anext(one)
            assert (await opened(api, path, {})).status_code == 503
            known = await opened(api, path, bearer(server))
            assert known.status_code == 200
            kind, problem = await last_event(lines[0])
            assert (kind, problem["code"]) == ("refused", "operator/busy")
            for stream in [*streams, known]:
                await stream.aclose()

    run(main())


def test_one_token_does_not_take_all_streams(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path, tokens=True) as (server, _, api):
            path = "/api/overview/events"
            ada = range(MAX_STREAMS_PER_SUBJECT)
            streams = [await opened(api, path, bearer(server, "ada")) for _ in ada]
            lines = [stream.aiter_lines() for stream in streams]
            for one in lines:
                await anext(one)
            assert (await opened(api, path, bearer(server, "ada"))).status_code == 503
            streams.append(await opened(api, path, bearer(server, "bob")))
            assert streams[-1].status_code == 200
            for stream in streams:
                await stream.aclose()

    run(main())
