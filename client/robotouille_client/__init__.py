"""Asyncio client library, bots, window and offline commands.

async with connect("ws://127.0.0.1:8765", name="ada") as client:
    game = await client.join("KQXZB-MHTWA")
    async for event in game:
        ...
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille_client.client import Client, connect
    from robotouille_client.errors import (
        ConnectionFailedError,
        ProtocolError,
        RetryLaterError,
        RobotouilleError,
        UntrustedRedirectError,
    )
    from robotouille_client.game import Game
    from robotouille_client.sansio.game_events import (
        ActRejected,
        ActResult,
        Announced,
        ChatReceived,
        ChatRejected,
        ChatRepeated,
        GameEnded,
        GameEvent,
        ObservationReceived,
        RosterChanged,
        StateChanged,
        TeamTold,
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
    "ActRejected",
    "ActResult",
    "Announced",
    "ChatReceived",
    "ChatRejected",
    "ChatRepeated",
    "Client",
    "ConnectionFailedError",
    "Game",
    "GameEnded",
    "GameEvent",
    "ObservationReceived",
    "ProtocolError",
    "RetryLaterError",
    "RobotouilleError",
    "RosterChanged",
    "StateChanged",
    "TeamTold",
    "UntrustedRedirectError",
    "connect",
]
