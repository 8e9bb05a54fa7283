"""How long the operator's port waits for a client."""

from __future__ import annotations

__all__ = ["KEEP_ALIVE_SECONDS", "REQUEST_SECONDS", "STALL_SECONDS"]

REQUEST_SECONDS = 10.0
"""For a handshake, for a request's head, and for its body."""
KEEP_ALIVE_SECONDS = 5
"""For the first byte of the next request."""
STALL_SECONDS = 30.0
"""For any progress of an answer that waits to be read."""
