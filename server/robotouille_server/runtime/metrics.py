"""Metrics of the server in the Prometheus format."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator

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
        return HistogramMetricFamily(name, text, buckets=rows, sum_value=self.total)


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
        yield GaugeMetricFamily(
            "robotouille_cluster_nodes", "Nodes that are alive, as this node sees them", self.nodes
        )
        yield GaugeMetricFamily(
            "robotouille_cluster_lease_age_seconds",
            "Seconds since this node's lease was renewed",
            self.lease_age,
        )
        yield GaugeMetricFamily(
            "robotouille_cluster_uncommitted",
            "Episodes that wait for a quorum for more than half a second",
            self.uncommitted,
        )
        yield CounterMetricFamily(
            "robotouille_cluster_takeovers", "Episodes taken over", value=self.takeovers
        )
        yield CounterMetricFamily(
            "robotouille_cluster_fenced", "Episodes lost to other nodes", value=self.fenced
        )
        yield self.commit.family(
            "robotouille_cluster_commit_seconds", "Time until a quorum has a write"
        )


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
        self.connections = Gauge(
            "robotouille_connections", "Open connections", registry=self.registry
        )
        self.episodes = Gauge(
            "robotouille_episodes", "Episodes that have not ended", registry=self.registry
        )
        self.failing = Gauge(
            "robotouille_failing_recordings",
            "Episodes paused because their recording cannot be written",
            registry=self.registry,
        )
        self.errors = Counter(
            "robotouille_errors", "Error messages sent, by code", ["code"], registry=self.registry
        )
        self.dropped = Counter(
            "robotouille_dropped_connections",
            "Connections closed by the server, by reason",
            ["reason"],
            registry=self.registry,
        )
        self.outcomes = Counter(
            "robotouille_outcomes", "Episodes ended, by outcome", ["reason"], registry=self.registry
        )
        self.snapshots = Counter(
            "robotouille_catch_up_snapshots",
            "Snapshots sent instead of deltas to clients that fell behind",
            registry=self.registry,
        )
        self.resumed = Counter(
            "robotouille_resumed_connections",
            "Connections resumed by clients",
            registry=self.registry,
        )
        self.restored = Counter(
            "robotouille_restored_episodes",
            "Episodes restored from their recordings at startup",
            registry=self.registry,
        )
        self.registry.register(self)
        self._begin_at_zero()

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
        yield CounterMetricFamily("robotouille_steps", "Steps taken", value=self.steps)
        moves = CounterMetricFamily("robotouille_moves", "Actions, by result", labels=["result"])
        moves.add_metric(["applied"], self.applied)
        moves.add_metric(["rejected"], self.rejected)
        yield moves
        yield CounterMetricFamily(
            "robotouille_received_messages", "Messages received", value=self.received
        )
        yield CounterMetricFamily(
            "robotouille_sent_messages", "Messages sent", value=self.sent_messages
        )
        yield CounterMetricFamily(
            "robotouille_sent_bytes", "Bytes of messages sent", value=self.sent_bytes
        )
        yield CounterMetricFamily(
            "robotouille_suppressed_log_lines",
            "Log lines suppressed because similar lines are too frequent",
            value=self.log_suppressed,
        )
        # Without `--mqtt` there is no value, so that the alert on a lost broker does not fire.
        yield _known(
            "robotouille_mqtt_connected",
            "1 while the server is connected to the MQTT broker",
            self.mqtt_connected,
        )
        yield CounterMetricFamily(
            "robotouille_mqtt_published",
            "Messages published to the MQTT broker",
            value=self.mqtt_published,
        )
        dropped = CounterMetricFamily(
            "robotouille_mqtt_dropped",
            "Steps and messages not published over MQTT, and commands not read",
            labels=["what"],
        )
        dropped.add_metric(["steps"], self.mqtt_dropped_steps)
        dropped.add_metric(["messages"], self.mqtt_dropped_messages)
        dropped.add_metric(["commands"], self.mqtt_dropped_commands)
        yield dropped
        yield _known(
            "robotouille_disk_free_bytes", "Free bytes on the recordings' disk", self.disk_free
        )
        yield _known("robotouille_open_descriptors", "Open file descriptors", self.descriptors)
        yield _known(
            "robotouille_max_descriptors",
            "Maximum number of file descriptors",
            self.max_descriptors,
        )
        yield GaugeMetricFamily(
            "robotouille_busiest_participant_bytes_per_second",
            "Bytes per second from the participant who sends most",
            value=self.busiest_participant,
        )
        yield self.lateness.family("robotouille_step_lateness_seconds", "Delay of scheduled steps")
        yield self.age.family(
            "robotouille_delta_age_seconds",
            "Time from taking a step to sending its last delta, recording included",
        )

        if self.cluster is not None:
            yield from self.cluster.collect()

    def page(self) -> bytes:
        """Return the metrics in the exposition format."""
        return generate_latest(self.registry)

    def recent_page(self, now: float) -> bytes:
        """Return a page that is at most `PAGE_SECONDS` old. `now` is the event loop's time."""
        if self._recent is None or now - self._recent[0] >= PAGE_SECONDS:
            self._recent = now, self.page()
        return self._recent[1]


def _known(name: str, text: str, value: int | None) -> GaugeMetricFamily:
    """Return a gauge, without a value if the value is unknown."""
    family = GaugeMetricFamily(name, text)
    if value is not None:
        family.add_metric([], value)
    return family
