"""Metrics of a node of a cluster, which exports more than a server without NATS."""

from robotouille_server.runtime.metrics import ClusterMetrics, Metrics

__all__ = ["dropped", "node_metrics", "sample"]


def node_metrics() -> Metrics:
    """Return new metrics of a node."""
    metrics = Metrics()
    metrics.cluster = ClusterMetrics()
    return metrics


def sample(metrics: Metrics, name: str, **labels: str) -> float:
    """Return the value of a metric as it is exported; 0 if it has no sample."""
    return metrics.registry.get_sample_value(f"robotouille_{name}", labels) or 0.0


def dropped(metrics: Metrics, reason: str) -> float:
    """Return how many connections the server has closed for a reason."""
    return sample(metrics, "dropped_connections_total", reason=reason)
