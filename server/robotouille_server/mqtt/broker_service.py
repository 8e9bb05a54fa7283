"""A running server on a broker: `async with on_broker(server): …`."""

from __future__ import annotations

import asyncio
import random
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from robotouille.release import VERSION
from robotouille_server.app import Server
from robotouille_server.mqtt.address import BrokerAddress, server_name
from robotouille_server.mqtt.commands import Commands
from robotouille_server.mqtt.connection import Connect, broker, require_mqtt
from robotouille_server.mqtt.link import BrokerLink, encoded
from robotouille_server.mqtt.models import Presence
from robotouille_server.mqtt.outbox import Outbox
from robotouille_server.mqtt.tap import Tap
from robotouille_server.mqtt.topics import Topics
from robotouille_server.mqtt.watches import Watches
from robotouille_server.runtime.logs import get_logger

__all__ = ["on_broker"]


@asynccontextmanager
async def on_broker(
    server: Server, *, connect: Connect | None = None, rng: random.Random | None = None
) -> AsyncIterator[Topics]:
    """Tell the broker of the settings what goes on in a server, and take commands, until the block
    is left; the topics. It is not waited for the broker, now or later.

    Args:
        connect: Makes a connection; to the broker of the settings if None.
        rng: For the pauses between attempts; the operating system's if None.

    Raises:
        RobotouilleError: A setting cannot be used, or the extra `mqtt` is missing.
    """
    settings = server.settings
    topics = Topics(server_name(settings, server.worker, server.port))
    if connect is None:
        require_mqtt()
        address = BrokerAddress.from_settings(settings)
        will = topics.presence, encoded(Presence(state="gone"))
        connect = broker(address, topics.server, will)
        get_logger().info("broker", url=str(address), name=topics.server)
    outbox = Outbox(server.metrics)
    watches = Watches(server.lobby.rooms.values, server.tokens.revoked)
    now = asyncio.get_running_loop().time
    link = BrokerLink(
        outbox,
        watches,
        Commands(server, watches, topics, now),
        topics,
        server.metrics,
        presence=_presence(server),
        connect=connect,
        rng=rng or random.SystemRandom(),
    )
    server.lobby.observe(Tap(outbox, watches, topics, server.wall))
    running = asyncio.create_task(link.run(), name="broker")
    try:
        yield topics
    finally:
        link.stop()
        await running


def _presence(server: Server) -> Presence:
    worker, url = server.worker, server.url
    if server.settings.host in ("0.0.0.0", "::"):  # noqa: S104
        url = f"{url.partition(':')[0]}://{socket.gethostname()}:{server.port}"
    return Presence(
        state="online",
        url=url,
        version=VERSION,
        since_utc_ms=round(server.wall() * 1000),
        worker=worker.index,
        workers=worker.count,
    )
