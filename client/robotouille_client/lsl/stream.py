"""Watches an episode, and gives it to LSL until it is over."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from robotouille_client.client import Client
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.game import Game
from robotouille_client.lsl.outlets import Outlets

__all__ = ["Latency", "stream"]

FIRST_TRIPS = 5
KEPT_TRIPS = 12
TRIP_SECONDS = 5.0
"""Between two measurements, so that the last minute is known."""


class Latency:
    """How long messages are under way: half of the shortest round trip of the last minute.

    The shortest, as whatever made the others longer (a busy machine, a full queue) is nothing that
    holds for the next message.
    """

    def __init__(self) -> None:
        self.trips: deque[float] = deque(maxlen=KEPT_TRIPS)

    @property
    def seconds(self) -> float:
        """0 while nothing was measured."""
        return min(self.trips, default=0.0) / 2

    async def measure(self, client: Client) -> None:
        """One more round trip; none while the connection is away."""
        with suppress(ConnectionFailedError):
            self.trips.append(await client.round_trip())

    async def watch(self, client: Client) -> None:
        """Measure again and again."""
        while True:
            await asyncio.sleep(TRIP_SECONDS)
            await self.measure(client)


async def stream(
    client: Client, episode: str, opening: Callable[[Game, list[float]], Outlets]
) -> Game:
    """Watch an episode to its end; the game.

    Args:
        opening: Makes the outlets, from the game and how long messages are under way.

    Raises:
        ConnectionFailedError: The connection is over.
        ProtocolError: The server refuses.
    """
    latency = Latency()
    for _ in range(FIRST_TRIPS):
        await latency.measure(client)
    game = await client.join(episode, role="spectator")
    outlets = opening(game, [trip / 2 for trip in latency.trips] or [0.0])
    measuring = asyncio.create_task(latency.watch(client), name="round trips")
    try:
        async for event in game:
            outlets.push(event, game.step, latency.seconds)
    finally:
        measuring.cancel()
    return game
