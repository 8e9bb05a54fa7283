"""Transport: WebSocket connections, TLS, and the limits that connections share."""

from robotouille_server.transport.admission import (
    MAX_SURPLUS_CONNECTIONS,
    SILENT_FACTOR,
    Admission,
    Newcomers,
)
from robotouille_server.transport.connection import Connection, PendingConnection, cut, frame_of
from robotouille_server.transport.loop_budget import LoopBudget, LoopTurns
from robotouille_server.transport.peer import MAX_HELD, Peer
from robotouille_server.transport.tls import ServerTLS

__all__ = [
    "MAX_HELD",
    "MAX_SURPLUS_CONNECTIONS",
    "SILENT_FACTOR",
    "Admission",
    "Connection",
    "LoopBudget",
    "LoopTurns",
    "Newcomers",
    "Peer",
    "PendingConnection",
    "ServerTLS",
    "cut",
    "frame_of",
]
