"""Event streams: tokens that expire, and limits."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from robotouille_server import Server
from robotouille_server.auth.keys import rotate
from robotouille_server.operator.event_streams import MAX_STREAMS, MAX_STREAMS_PER_SUBJECT
from tests.support.operator import Api, bearer, table, viewing
from tests.support.samples import quick_sample
from tests.support.virtual_time import VirtualTimeLoop, virtual


def wall() -> float:
    """Return a wall-clock time that follows the loop's virtual time."""
    try:
        loop = asyncio.get_running_loop()
    except RuntimeError:
        return 1_800_000_000.0
    assert isinstance(loop, VirtualTimeLoop)
    return 1_800_000_000.0 + loop.time()


async def last_event(lines: Any) -> Any:
    """Return the type and data of the last event of a stream."""
    async with asyncio.timeout(60):
        kept = [line async for line in lines if line]
    assert kept[-2].startswith("event: "), kept[-3:]
    return kept[-2].removeprefix("event: "), json.loads(kept[-1].removeprefix("data: "))


async def opened(api: Api, path: str, headers: dict[str, str]) -> httpx.Response:
    request = api.http.build_request("GET", path, headers=headers)
    return await api.http.send(request, stream=True)


def expire(server: Server, keys: Path) -> None:
    """Do nothing: the token expires by itself."""


def rotate_away(server: Server, keys: Path) -> None:
    rotate(keys, keep=1)


@pytest.mark.parametrize(
    ("what", "code", "seconds", "within"),
    quick_sample([(rotate_away, "auth/invalid", 3600, 3), (expire, "auth/expired", 30, 32)]),
)
@virtual
async def test_stream_ends_when_its_token_does(
    tmp_path: Path, what: Callable[[Server, Path], None], code: str, seconds: float, within: float
) -> None:
    keys = tmp_path / "state" / "keys.json"
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


@virtual
async def test_token_replaces_the_oldest_stream_without_one(tmp_path: Path) -> None:
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


@virtual
async def test_streams_are_limited_per_subject(tmp_path: Path) -> None:
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
