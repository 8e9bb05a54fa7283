"""Log of a connection to NATS, which stays short while no server can be reached."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf

from robotouille_server.runtime.logs import get_logger

REPORT_SECONDS = 10.0
"""Seconds between two lines about failed attempts. There are several attempts a second."""


class ConnectionLog:
    """Logs the loss of a connection, the attempts to connect again, and the return.

    Args:
        now: Returns the time in seconds.

    Attributes:
        reason: The last error since the connection was made or lost, or an empty text.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self.reason = ""
        self._now = now
        self._connected = False
        self._attempts = 0
        self._reported_at = -inf

    def failed(self, error: Exception) -> None:
        """Log an error of the connection, or count a failed attempt to connect."""
        reason = str(error) or type(error).__name__
        if not self._connected:
            self._attempt_failed(reason)
        elif reason != self.reason:
            get_logger().warning("NATS", error=reason)
        self.reason = reason

    def _attempt_failed(self, reason: str) -> None:
        self._attempts += 1
        if (now := self._now()) - self._reported_at >= REPORT_SECONDS:
            self._reported_at = now
            get_logger().warning(
                "NATS cannot be reached", failed_attempts=self._attempts, error=reason
            )

    def lost(self) -> None:
        get_logger().error("connection to NATS lost")
        self._connected, self._attempts, self.reason = False, 0, ""
        self._reported_at = self._now()

    def connected(self) -> None:
        """Note the first connection."""
        self._connected, self.reason = True, ""

    def returned(self, server: str) -> None:
        attempts = self._attempts
        get_logger().info("connected to NATS again", server=server, failed_attempts=attempts)
        self.connected()
