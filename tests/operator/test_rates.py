"""Rates and percentiles from counters that only grow."""

from __future__ import annotations

from robotouille_server.admin.rates import History, RateOf
from robotouille_server.runtime.metrics import Metrics


def test_percentiles_are_upper_bounds_of_the_last_minutes_steps() -> None:
    metrics = Metrics()
    history = History(metrics)
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


def test_nothing_is_late_where_nothing_was_scheduled() -> None:
    history = History(Metrics())
    for second in range(3):
        history.sample(float(second))
    assert history.lateness().model_dump() == {"steps": 0, "p50": None, "p99": None, "p999": None}


def test_history_is_a_minute_and_rates_are_the_last_seconds() -> None:
    metrics = Metrics()
    history = History(metrics)
    assert history.rate(lambda s: s.steps) == 0.0
    for second in range(100):
        metrics.steps += 10 if second < 90 else 30
        history.sample(float(second))
    assert len(history.seconds(lambda s: s.steps)) == 60
    assert history.seconds(lambda s: s.steps)[0] == 10.0
    assert history.rate(lambda s: s.steps) == 30.0


def test_a_rate_is_measured_over_a_second_at_least_and_never_negative() -> None:
    rate = RateOf()
    assert rate("a", 100, 0.0) is None
    assert rate("a", 110, 0.5) is None
    assert rate("a", 120, 2.0) == 10.0
    assert rate("a", 500, 2.1) == 10.0
    assert rate("a", 30, 4.0) == 0.0
    rate.forget(20.0)
    assert rate("a", 60, 20.0) is not None
    rate.forget(60.0)
    assert rate("a", 60, 60.0) is None
