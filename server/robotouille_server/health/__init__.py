"""What a server may run out of, and what its operator is told of it."""

from robotouille_server.health.alerts import Alert, alerts
from robotouille_server.health.sampling import SAMPLE_SECONDS, Busiest, Disk, Health, System

__all__ = ["SAMPLE_SECONDS", "Alert", "Busiest", "Disk", "Health", "System", "alerts"]
