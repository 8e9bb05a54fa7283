"""A lost connection is sought again after pauses that grow from 100 ms to 5 s, at random."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.asyncio.client import connect as open_socket

from robotouille_client import Client
from robotouille_client import client as connection
from robotouille_client.loadtest.worker import participant
from robotouille_client.loadtest.worker.light_connection import LightConnection
from robotouille_client.loadtest.worker.participant import Environment, LostError, Participant
from robotouille_client.sansio.backoff import pauses
from robotouille_client.sockets import server_uri
from tests.support.servers import crash, serving
from tests.support.virtual_time import run

ATTEMPTS = 12
LONGEST = [0.2, 0.4, 0.8, 1.6, 3.2] + [5.0] * (ATTEMPTS - 5)
"""Of each pause; the shortest is half of it."""
MOMENT = 0.05
"""More than an attempt takes that is refused at once."""


def first(seed: int, count: int = ATTEMPTS) -> list[float]:
    return list(islice(pauses(random.Random(seed)), count))


@given(st.integers(), st.integers(1, 200))
def test_every_pause_lies_between_100_ms_and_5_s_and_they_double(seed: int, count: int) -> None:
    longest = 0.1
    for pause in first(seed, count):
        longest = min(2 * longest, 5.0)
        assert max(0.1, longest / 2) <= pause <= longest


def test_a_repeated_seed_gives_the_same_pauses_and_another_one_others() -> None:
    assert first(1) == first(1)
    assert not set(first(1)) & set(first(2))


def test_clients_that_are_cut_together_come_back_spread_out() -> None:
    """At each attempt, the last ones too, the crowd fills most of what is possible."""
    for longest, drawn in zip(LONGEST, zip(*map(first, range(200)), strict=True), strict=True):
        assert min(drawn) < 0.55 * longest
        assert max(drawn) > 0.95 * longest
        assert 0.7 * longest < sum(drawn) / len(drawn) < 0.8 * longest


def assert_backed_off(attempts: list[float]) -> None:
    """The times, the loss of the connection first, are those that were asked for."""
    gaps = [later - earlier for earlier, later in pairwise(attempts)]
    assert len(gaps) == ATTEMPTS
    for gap, longest in zip(gaps, LONGEST, strict=True):
        assert longest / 2 - 1e-6 <= gap <= longest + MOMENT, gaps
    assert len({round(gap, 3) for gap in gaps[-5:]}) == 5, "the longest pauses are all the same"


class Attempts:
    """Whoever would open a connection, and when."""

    def __init__(self, opener: Callable[..., Awaitable[Any]]) -> None:
        self._opener = opener
        self._enough = asyncio.Event()
        self.times: list[float] = []

    def begin(self) -> None:
        """The connection is lost now."""
        self.times = [asyncio.get_running_loop().time()]

    async def all(self) -> list[float]:
        await self._enough.wait()
        return self.times[: ATTEMPTS + 1]

    async def open(self, *arguments: Any, **options: Any) -> Any:
        if self.times:
            self.times.append(asyncio.get_running_loop().time())
            if len(self.times) > ATTEMPTS:
                self._enough.set()
        return await self._opener(*arguments, **options)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_client_whose_server_is_gone_tries_at_those_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    async def main() -> list[float]:
        attempts = Attempts(open_socket)
        monkeypatch.setattr(connection, "open_socket", attempts.open)
        async with serving(tmp_path) as server:
            async with Client(server.url, name="ada", seed=seed) as ada:
                attempts.begin()
                await crash(server)
                times = await attempts.all()
                assert not ada.connected.is_set()
                return times

    times = run(main())
    assert_backed_off(times)
    waited = [later - earlier for earlier, later in pairwise(times)]
    assert waited == pytest.approx(first(seed), abs=MOMENT)


def test_a_bot_of_the_load_tester_tries_at_those_times(monkeypatch: pytest.MonkeyPatch) -> None:
    async def refuse(*_: object) -> LightConnection:
        raise LostError("nobody listens")

    async def main() -> list[float]:
        attempts = Attempts(refuse)
        monkeypatch.setattr(participant, "open_connection", attempts.open)
        environment = Environment(server_uri("ws://127.0.0.1:9"), rng=random.Random(1))
        attempts.begin()
        returning = asyncio.ensure_future(Participant(environment, "ada").return_to_seat())
        times = await attempts.all()
        returning.cancel()
        await asyncio.wait({returning})
        return times

    assert_backed_off(run(main()))


def test_pauses_begin_anew_once_the_client_was_welcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        attempts = Attempts(open_socket)
        monkeypatch.setattr(connection, "open_socket", attempts.open)
        async with serving(tmp_path) as server, Client(server.url, name="ada", seed=1) as ada:
            for _ in range(6):
                attempts.begin()
                assert ada._socket is not None
                ada.connected.clear()
                ada._socket.transport.abort()
                await ada.connected.wait()
                lost, found = attempts.times
                assert 0.1 <= found - lost <= 0.2 + MOMENT

    run(main())
