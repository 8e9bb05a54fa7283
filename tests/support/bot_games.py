"""Games that bots play over real sockets."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from robotouille.episode import Clock
from robotouille_client import connect
from robotouille_client.bots import play
from robotouille_client.bots.seat_policy import MakePolicy
from tests.support.servers import serving

__all__ = ["finish"]


async def finish(
    folder: Path, name: str, clock: Clock, seats: int, make: MakePolicy, **options: Any
) -> Mapping[str, Any]:
    """Play one episode with a bot in each seat; its outcome."""
    async with serving(folder, mode=clock, max_steps=1500, **options) as server:
        async with connect(server.url, name="host") as host:
            created = await host.create(name, seats=seats)

            async def bot(number: int) -> Mapping[str, Any]:
                encoding: Literal["msgpack", "json"] = "json" if number % 2 else "msgpack"
                async with connect(server.url, name=f"bot{number}", encoding=encoding) as client:
                    await asyncio.sleep(0.01 * number)
                    return await play(await client.join(created.code), make, threaded=False)

            outcomes = await asyncio.gather(*(bot(i) for i in range(seats)))
    assert all(outcome == outcomes[0] for outcome in outcomes)
    return outcomes[0]
