"""Distributions, schedules and shares of the load tester."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.episode.rules import Clock
from robotouille_client.loadtest.histogram import Histogram
from robotouille_client.loadtest.players import SETTLED, StepSchedule
from robotouille_client.loadtest.server_monitor import fetch_page
from robotouille_client.loadtest.workload import LoadPlan, parse_mix

durations = st.floats(min_value=2e-6, max_value=1e4)


def histogram(values: list[float]) -> Histogram:
    made = Histogram()
    for value in values:
        made.add(value)
    return made


@given(st.lists(durations, min_size=1, max_size=300), st.sampled_from([1.0, 50.0, 90.0, 99.0]))
def test_percentiles_are_exact_to_one_per_cent(values: list[float], percent: float) -> None:
    exact = sorted(values)[max(0, -(-len(values) * percent // 100).__int__() - 1)]
    assert histogram(values).percentile(percent) == pytest.approx(exact, rel=0.011)


@given(
    st.lists(st.floats(min_value=0, max_value=0.09), min_size=SETTLED, max_size=60),
    st.floats(min_value=0, max_value=1e5),
    st.sampled_from([1.0, 5.0, 10.0, 60.0]),
)
def test_ages_are_relative_to_the_best_delivery(
    delays: list[float], begun: float, rate: float
) -> None:
    """Step n is due at begun + n / rate, and its delta arrives delays[n] later."""
    transit = 0.0001
    schedule = StepSchedule(rate, transit)
    ages = [
        schedule.arrived(step, begun + step / rate + transit + delay)
        for step, delay in enumerate(delays)
    ]
    assert schedule.settled
    best = min(delays)
    assert ages[-1] == pytest.approx(delays[-1] - best + transit, abs=1e-6)
    assert schedule.due(7) == pytest.approx(begun + 7 / rate + best, abs=1e-6)


@given(
    st.dictionaries(st.sampled_from(list(Clock)), st.integers(0, 9), min_size=1).filter(
        lambda mix: sum(mix.values()) > 0
    ),
    st.integers(0, 500),
    st.integers(1, 7),
    st.integers(0, 3000),
)
def test_each_bot_is_in_exactly_one_share(
    mix: dict[Clock, int], rooms: int, processes: int, spectators: int
) -> None:
    plan = LoadPlan(url="ws://x", rooms=rooms, mix=mix, processes=processes, storm=rooms,
                    slow_readers=rooms // 2, spectators=spectators)  # fmt: skip
    by_clock = plan.rooms_by_clock()
    assert sum(by_clock.values()) == rooms
    total = sum(mix.values())
    assert all(abs(count - rooms * mix[clock] / total) < 1 for clock, count in by_clock.items())
    shares = plan.shares()
    assert len(shares) == processes
    for clock in Clock:
        assert sum(share.rooms.count(clock) for share in shares) == by_clock.get(clock, 0)
    assert sum(share.spectators for share in shares) == spectators
    assert sum(share.storm for share in shares) == rooms
    assert sum(share.slow_readers for share in shares) == rooms // 2
    assert len({share.seed for share in shares}) == processes


def test_mix_has_clocks_and_weights() -> None:
    assert parse_mix("realtime:8, lockstep:1,turn") == {
        Clock.REALTIME: 8, Clock.LOCKSTEP: 1, Clock.TURN: 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    "page", [b"robotouille_episodes 1\n" * 100_000, b"robotouille_episodes many\n"]
)
@pytest.mark.parametrize("head", [b"HTTP/1.0 200 OK\r\n\r\n", b"garbage\r\n\r\n"])
async def test_odd_pages_of_metrics_are_ignored(page: bytes, head: bytes) -> None:
    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(head + page)
        with contextlib.suppress(ConnectionError):
            await writer.drain()
        writer.close()

    async with await asyncio.start_server(answer, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        assert await fetch_page(f"http://127.0.0.1:{port}/metrics") is None
