"""What is counted is what Prometheus reads."""

from __future__ import annotations

from robotouille_server.runtime.metrics import BUCKETS, Durations, Metrics


def lines(metrics: Metrics) -> list[str]:
    return metrics.page().decode().splitlines()


def test_a_duration_is_counted_up_to_the_bound_that_it_does_not_exceed() -> None:
    durations = Durations()
    for seconds in (0.0, BUCKETS[0], BUCKETS[1], 1e9):
        durations.observe(seconds)
    assert durations.counts[:2] == [2, 1]
    assert durations.counts[-1] == 1
    assert durations.total == BUCKETS[0] + BUCKETS[1] + 1e9


def test_buckets_on_the_page_count_all_below() -> None:
    metrics = Metrics()
    for seconds in (0.0004, 0.004, 5.0):
        metrics.lateness.observe(seconds)
    page = lines(metrics)
    assert 'robotouille_step_lateness_seconds_bucket{le="0.0005"} 1.0' in page
    assert 'robotouille_step_lateness_seconds_bucket{le="0.005"} 2.0' in page
    assert 'robotouille_step_lateness_seconds_bucket{le="+Inf"} 3.0' in page


def test_plain_numbers_and_labels_are_on_the_page() -> None:
    metrics = Metrics()
    metrics.steps, metrics.applied, metrics.rejected = 3, 2, 1
    metrics.dropped.labels("flood").inc()
    page = lines(metrics)
    assert "robotouille_steps_total 3.0" in page
    assert 'robotouille_moves_total{result="rejected"} 1.0' in page
    assert 'robotouille_dropped_connections_total{reason="flood"} 1.0' in page


def test_what_is_not_known_has_no_value() -> None:
    metrics = Metrics()
    assert not [line for line in lines(metrics) if line.startswith("robotouille_disk_free_bytes ")]
    metrics.disk_free = 7
    assert "robotouille_disk_free_bytes 7.0" in lines(metrics)
