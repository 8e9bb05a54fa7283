"""Metrics of the server in the Prometheus format."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping

from prometheus_client import CollectorRegistry, Counter, Gauge, generate_latest
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from robotouille.episode import Reason
from robotouille.protocol.error_codes import ErrorCode

PREFIX = "robotouille_"
"""Beginning of the names of all metrics."""
DROPPED = (
    "silent",
    "stalled",
    "flood",
    "early",
    "descriptors",
    "full",
    "displaced",
    "crowded",
    "revoked",
)
"""Reasons for which the server closes connections."""
PAGE_SECONDS = 1.0
"""Time for which a page is reused. Writing one takes a millisecond, which would delay steps if many
clients read the metrics in a loop."""
BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 1.0)
"""Upper bounds of the histograms' buckets, in seconds."""


class Durations:
    """Histogram of durations in seconds.

    `counts[i]` counts the durations up to `BUCKETS[i]`; the last entry counts the longer ones.
    """

    def __init__(self) -> None:
        self.counts = [0] * (len(BUCKETS) + 1)
        self.total = 0.0

    def observe(self, seconds: float) -> None:
        self.counts[bisect_left(BUCKETS, seconds)] += 1
        self.total += seconds

    def family(self, name: str, text: str) -> HistogramMetricFamily:
        """Return the histogram for Prometheus, whose buckets are cumulative."""
        below, rows = 0, []
        for bound, count in zip([*map(str, BUCKETS), "+Inf"], self.counts, strict=True):
            below += count
            rows.append((bound, below))
        return HistogramMetricFamily(PREFIX + name, text, buckets=rows, sum_value=self.total)


class ClusterMetrics:
    """Metrics of a node of a cluster."""

    def __init__(self) -> None:
        self.nodes = 0
        self.lease_age = 0.0
        self.uncommitted = 0
        self.takeovers = self.fenced = 0
        self.commit = Durations()

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics."""
        yield _gauge("cluster_nodes", "Nodes that are alive, as this node sees them", self.nodes)
        yield _gauge(
            "cluster_lease_age_seconds",
            "Seconds since this node's lease was renewed",
            self.lease_age,
        )
        yield _gauge(
            "cluster_uncommitted",
            "Episodes that wait for a quorum for more than half a second",
            self.uncommitted,
        )
        yield _total("cluster_takeovers", "Episodes taken over", self.takeovers)
        yield _total("cluster_fenced", "Episodes lost to other nodes", self.fenced)
        yield self.commit.family("cluster_commit_seconds", "Time until a quorum has a write")


class Metrics(Collector):
    """Metrics of one server, in a registry of its own.

    Counts that change with every step or message are plain numbers, which `collect` converts on
    request.
    """

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.steps = self.applied = self.rejected = 0
        self.log_suppressed = 0
        self.mqtt_connected: bool | None = None
        self.mqtt_published = self.mqtt_dropped_steps = self.mqtt_dropped_messages = 0
        self.mqtt_dropped_commands = 0
        self.received = self.sent_messages = self.sent_bytes = 0
        self.disk_free: int | None = None
        self.descriptors: int | None = None
        self.max_descriptors: int | None = None
        self.busiest_participant = 0.0
        self.lateness = Durations()
        self.age = Durations()
        self.cluster: ClusterMetrics | None = None
        self._recent: tuple[float, bytes] | None = None
        self.connections = self._gauge("connections", "Open connections")
        self.episodes = self._gauge("episodes", "Episodes that have not ended")
        self.failing = self._gauge(
            "failing_recordings", "Episodes paused because their recording cannot be written"
        )
        self.errors = self._counter("errors", "Error messages sent, by code", "code")
        self.dropped = self._counter(
            "dropped_connections", "Connections closed by the server, by reason", "reason"
        )
        self.outcomes = self._counter("outcomes", "Episodes ended, by outcome", "reason")
        self.snapshots = self._counter(
            "catch_up_snapshots", "Snapshots sent instead of deltas to clients that fell behind"
        )
        self.resumed = self._counter("resumed_connections", "Connections resumed by clients")
        self.restored = self._counter(
            "restored_episodes", "Episodes restored from their recordings at startup"
        )
        self.registry.register(self)
        self._begin_at_zero()

    def _gauge(self, name: str, text: str) -> Gauge:
        return Gauge(PREFIX + name, text, registry=self.registry)

    def _counter(self, name: str, text: str, *labels: str) -> Counter:
        return Counter(PREFIX + name, text, labels, registry=self.registry)

    def _begin_at_zero(self) -> None:
        # Prometheus sees no increase in a series that begins with its first event, so an alert
        # would miss the first attack.
        for code in ErrorCode:
            self.errors.labels(code.value)
        for reason in DROPPED:
            self.dropped.labels(reason)
        for outcome in Reason:
            self.outcomes.labels(outcome.value)

    def collect(self) -> Iterator[Metric]:
        """Yield the plain numbers as metrics."""
        yield _total("steps", "Steps taken", self.steps)
        moves = {"applied": self.applied, "rejected": self.rejected}
        yield _totals("moves", "Actions, by result", "result", moves)
        yield _total("received_messages", "Messages received", self.received)
        yield _total("sent_messages", "Messages sent", self.sent_messages)
        yield _total("sent_bytes", "Bytes of messages sent", self.sent_bytes)
        yield _total(
            "suppressed_log_lines",
            "Log lines suppressed because similar lines are too frequent",
            self.log_suppressed,
        )
        yield from self._mqtt()
        yield _gauge("disk_free_bytes", "Free bytes on the recordings' disk", self.disk_free)
        yield _gauge("open_descriptors", "Open file descriptors", self.descriptors)
        yield _gauge("max_descriptors", "Maximum number of file descriptors", self.max_descriptors)
        yield _gauge(
            "busiest_participant_bytes_per_second",
            "Bytes per second from the participant who sends most",
            self.busiest_participant,
        )
        yield self.lateness.family("step_lateness_seconds", "Delay of scheduled steps")
        yield self.age.family(
            "delta_age_seconds",
            "Time from taking a step to sending its last delta, recording included",
        )
        if self.cluster is not None:
            yield from self.cluster.collect()

    def _mqtt(self) -> Iterator[Metric]:
        # Without `--mqtt` the gauge has no value, so that the alert on a lost broker does not fire.
        yield _gauge(
            "mqtt_connected",
            "1 while the server is connected to the MQTT broker",
            self.mqtt_connected,
        )
        yield _total("mqtt_published", "Messages published to the MQTT broker", self.mqtt_published)
        dropped = {
            "steps": self.mqtt_dropped_steps,
            "messages": self.mqtt_dropped_messages,
            "commands": self.mqtt_dropped_commands,
        }
        text = "Steps and messages not published over MQTT, and commands not read"
        yield _totals("mqtt_dropped", text, "what", dropped)

    def page(self) -> bytes:
        """Return the metrics in the exposition format."""
        return generate_latest(self.registry)

    def recent_page(self, now: float) -> bytes:
        """Return a page that is at most `PAGE_SECONDS` old. `now` is the event loop's time."""
        if self._recent is None or now - self._recent[0] >= PAGE_SECONDS:
            self._recent = now, self.page()
        return self._recent[1]


def _total(name: str, text: str, value: float) -> CounterMetricFamily:
    return CounterMetricFamily(PREFIX + name, text, value=value)


def _totals(name: str, text: str, label: str, values: Mapping[str, float]) -> CounterMetricFamily:
    family = CounterMetricFamily(PREFIX + name, text, labels=[label])
    for key, value in values.items():
        family.add_metric([key], value)
    return family


def _gauge(name: str, text: str, value: float | None) -> GaugeMetricFamily:
    """Return a gauge, without a value if the value is unknown."""
    family = GaugeMetricFamily(PREFIX + name, text)
    if value is not None:
        family.add_metric([], value)
    return family
