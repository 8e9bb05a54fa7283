"""The client side: an async library, bots, the window and the offline commands.

async with connect("ws://127.0.0.1:8765", name="ada") as client:
    game = await client.join("KQXZB")
    async for event in game:
        ...
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille_client.client import Client, connect
    from robotouille_client.errors import (
        ConnectionFailedError,
        NotYetError,
        ProtocolError,
        RobotouilleError,
        StrangerError,
    )
    from robotouille_client.game import Game
    from robotouille_client.sansio.game_events import (
        ActResult,
        Announced,
        Changed,
        GameEvent,
        Heard,
        NotSaid,
        Observed,
        Over,
        Refused,
        RosterChanged,
    )
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille_client.errors",
        "robotouille_client.sansio.game_events",
        "robotouille_client.game",
        "robotouille_client.client",
    )

__all__ = [
    "ActResult",
    "Announced",
    "Changed",
    "Client",
    "ConnectionFailedError",
    "Game",
    "GameEvent",
    "Heard",
    "NotSaid",
    "NotYetError",
    "Observed",
    "Over",
    "ProtocolError",
    "Refused",
    "RobotouilleError",
    "RosterChanged",
    "StrangerError",
    "connect",
]
