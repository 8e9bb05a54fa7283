"""Metrics of a node of a cluster, which exports more than a server without NATS."""

from robotouille_server.runtime.metrics import ClusterMetrics, Metrics

__all__ = ["node_metrics"]


def node_metrics() -> Metrics:
    """Return new metrics of a node."""
    metrics = Metrics()
    metrics.cluster = ClusterMetrics()
    return metrics
