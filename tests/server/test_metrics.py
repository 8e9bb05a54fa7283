"""Metrics on the Prometheus page."""

from __future__ import annotations

from robotouille_server.runtime.metrics import Metrics


def lines(metrics: Metrics) -> list[str]:
    return metrics.page().decode().splitlines()


def test_buckets_are_cumulative() -> None:
    metrics = Metrics()
    for seconds in (0.0004, 0.004, 5.0):
        metrics.lateness.observe(seconds)
    page = lines(metrics)
    assert 'robotouille_step_lateness_seconds_bucket{le="0.0005"} 1.0' in page
    assert 'robotouille_step_lateness_seconds_bucket{le="0.005"} 2.0' in page
    assert 'robotouille_step_lateness_seconds_bucket{le="+Inf"} 3.0' in page


def test_page_has_numbers_and_labels() -> None:
    metrics = Metrics()
    metrics.steps, metrics.applied, metrics.rejected = 3, 2, 1
    metrics.dropped.labels("flood").inc()
    page = lines(metrics)
    assert "robotouille_steps_total 3.0" in page
    assert 'robotouille_moves_total{result="rejected"} 1.0' in page
    assert 'robotouille_dropped_connections_total{reason="flood"} 1.0' in page
