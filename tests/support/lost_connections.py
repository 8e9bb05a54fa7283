"""Episodes with lost connections."""

from __future__ import annotations

from robotouille_client import Client

__all__ = ["cut", "start"]


async def start(server, *clients: Client, **options):  # type: ignore[no-untyped-def]
    created = await clients[0].create("multi_agent/02", **options)
    return [await client.join(created.code) for client in clients]


def cut(client: Client) -> None:
    """Abort the client's connection, like a pulled cable."""
    assert client._socket is not None
    client._socket.transport.abort()
