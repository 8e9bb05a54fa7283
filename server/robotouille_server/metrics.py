"""What the server counts, for Prometheus."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

__all__ = ["Metrics"]

LATENESS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 1.0)


class Metrics:
    """The metrics of one server; each server has a registry of its own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.connections = Gauge(
            "robotouille_connections", "Open connections", registry=self.registry
        )
        self.episodes = Gauge(
            "robotouille_episodes", "Episodes that are not over", registry=self.registry
        )
        self.steps = Counter("robotouille_steps", "Steps taken", registry=self.registry)
        self.moves = Counter(
            "robotouille_moves", "Actions by result", ["result"], registry=self.registry
        )
        self.applied = self.moves.labels("applied")
        self.rejected = self.moves.labels("rejected")
        self.lateness = Histogram(
            "robotouille_step_lateness_seconds",
            "How late a scheduled step was taken",
            buckets=LATENESS,
            registry=self.registry,
        )
        self.sent_bytes = Counter(
            "robotouille_sent_bytes", "Bytes of messages sent", registry=self.registry
        )
        self.received = Counter(
            "robotouille_received_messages", "Messages received", registry=self.registry
        )
        self.errors = Counter(
            "robotouille_errors", "Errors answered, by code", ["code"], registry=self.registry
        )
        self.dropped = Counter(
            "robotouille_dropped_connections",
            "Connections dropped by the server, by reason",
            ["reason"],
            registry=self.registry,
        )
        self.outcomes = Counter(
            "robotouille_outcomes", "Episodes ended, by reason", ["reason"], registry=self.registry
        )
        self.snapshots = Counter(
            "robotouille_catch_up_snapshots",
            "Snapshots sent in place of deltas to clients that fell behind",
            registry=self.registry,
        )

    def page(self) -> bytes:
        """The exposition format's text."""
        return generate_latest(self.registry)
