"""Steps that arrive at irregular times are shown evenly."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator

import pytest
from tests.support.samples import quick_sample

from robotouille import World
from robotouille_client.window.sources.playout import MAX_DELAY, MAX_RATE, Playout

FRAME = 1 / 60


def line(steps: int, period: float, jitter: float, loss: float, seed: int) -> list[float]:
    """Return arrival times over TCP: 40 ms, jitter, and retransmissions that delay later steps."""
    dice, arrivals, last = random.Random(seed), [], 0.0
    for step in range(steps):
        late = 0.25 if dice.random() < loss else 0.0
        last = max(last, step * period + 0.04 + dice.random() * jitter + late)
        arrivals.append(last)
    return arrivals


def watch(arrivals: list[float], period: float, until: float) -> Iterator[tuple[float, float, int]]:
    """Yield the time, the shown step and the newest step, frame by frame."""
    state = World("multi_agent/02").initial
    playout, now, next_step = Playout(period), arrivals[0], 0
    while now < until:
        known = next_step
        while next_step < len(arrivals) and arrivals[next_step] <= now:
            playout.add(next_step, state, state if next_step else None)
            next_step += 1
        if next_step > known:
            playout.arrived(next_step - 1, arrivals[next_step - 1])
        shown = playout.at(now)
        assert math.isclose(shown.step + shown.phase, playout.position, abs_tol=1e-9)
        yield now, playout.position, next_step - 1
        now += FRAME


@pytest.mark.parametrize("seed", quick_sample(range(5)))
@pytest.mark.parametrize("rate", [2.0, 5.0, 10.0])
def test_playback_never_goes_back_or_jumps(rate: float, seed: int) -> None:
    period = 1 / rate
    arrivals = line(400, period, jitter=0.15, loss=0.03, seed=seed)
    course = list(watch(arrivals, period, arrivals[-1] + 1.0))
    moves = [after - before for (_, before, _), (_, after, _) in itertools.pairwise(course)]
    assert min(moves) >= 0.0
    assert max(moves) <= MAX_RATE * FRAME / period + 1e-9 < 1.0
    behind = [now - 0.04 - shown * period for now, shown, newest in course if newest < 399]
    assert max(behind) < MAX_DELAY + 0.15 + 0.25 + 0.3
    assert course[-1][1] == 400.0, "the last step is shown to its end"
    still = sum(move == 0.0 for move in moves[120:-120]) / len(moves[120:-120])
    assert still < 0.08


def test_no_delay_on_an_even_line() -> None:
    arrivals = line(100, 0.2, jitter=0.0, loss=0.0, seed=0)
    for now, shown, newest in watch(arrivals, 0.2, arrivals[-1]):
        assert shown == pytest.approx((now - 0.04) / 0.2, abs=0.02)
        assert newest <= shown + 0.02 <= newest + 1.04


def test_playback_continues_after_a_pause() -> None:
    arrivals = [step * 0.2 + (30.0 if step >= 50 else 0.0) for step in range(100)]
    course = list(watch(arrivals, 0.2, arrivals[-1]))
    moves = [after - before for (_, before, _), (_, after, _) in itertools.pairwise(course)]
    assert min(moves) >= 0.0
    assert max(moves) <= MAX_RATE * FRAME / 0.2 + 1e-9
    assert all(shown == pytest.approx(50.0) for now, shown, _ in course if 11.0 < now < 39.0)
    assert course[-1][1] == pytest.approx(99.0, abs=0.2)


def test_long_gaps_are_skipped_and_snapshots_shown_at_once() -> None:
    state = World("multi_agent/02").initial
    playout = Playout(0.2)
    assert playout.at(0.0) is None
    playout.add(0, state, None)
    playout.arrived(0, 0.0)
    for step in range(1, 51):
        playout.add(step, state, state)
    playout.arrived(50, 10.0)
    playout.at(10.0)
    assert playout.position >= 48
    playout.add(7, state, None)
    playout.arrived(7, 10.1)
    shown = playout.at(10.1)
    assert (shown.step, shown.previous) == (7, None)
