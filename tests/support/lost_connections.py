"""Episodes with lost connections."""

from __future__ import annotations

from asyncio import Transport

from robotouille.protocol import messages
from robotouille_client import Client, Game

__all__ = ["cut", "miss_a_step", "start", "transport_of"]


async def start(server, *clients: Client, **options):  # type: ignore[no-untyped-def]
    created = await clients[0].create("multi_agent/02", **options)
    return [await client.join(created.code) for client in clients]


def cut(client: Client) -> None:
    """Abort the client's connection, like a pulled cable."""
    transport_of(client).abort()


def transport_of(client: Client) -> Transport:
    """Return the transport of an open connection, which the library does not offer."""
    assert client._socket is not None
    return client._socket.transport


def miss_a_step(game: Game) -> None:
    """Let a game ask for a snapshot, because the next delta has not arrived."""
    game.receive(messages.Delta(step=game.step + 2), game.step_time)
