"""Connections to one node that never go to another one, unlike those of clients.

They write what they receive as evidence of spectators, so that the verdict compares it with the
recordings. A node that has lost an episode may send them only `moved` and `bye`.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from robotouille.protocol import messages
from robotouille.protocol.codec import MSGPACK
from tests.programs.drill.witness import rows_of

__all__ = ["DELAYED", "FAREWELLS", "Listener", "listening_to"]

FAREWELLS = ("moved", "bye")
DELAYED = ("delta", "said", "roster")
"""Messages that spectators receive together, a moment after they were recorded, or later if the
node is suspended in between. The verdict compares steps and chat with the recording."""
JOIN_SECONDS = 5.0


@dataclass(slots=True)
class Listener:
    """A spectator of one episode.

    Attributes:
        heard: The time and kind of each message.
        joined: Set when the episode's state has arrived.
        ended: Set when the connection has ended.
    """

    episode: str
    code: str
    file: Path
    heard: list[tuple[float, str]] = field(default_factory=list)
    joined: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    def after(self, moment: float) -> list[str]:
        """Return the kinds of the messages that came after a moment."""
        return [kind for at, kind in self.heard if at > moment]

    async def listen(self, socket: ClientConnection) -> None:
        """Watch the episode until the connection ends."""
        hello = messages.Hello(protocol=messages.PROTOCOL_VERSION, name="listener", kind="bot")
        join = messages.Join(episode=self.code, role="spectator", ref=1)
        await socket.send(MSGPACK.encode(hello))
        await socket.send(MSGPACK.encode(join))
        with self.file.open("w", encoding="utf-8") as file:
            file.write(json.dumps(["game", self.episode, None, "listener"]) + "\n")
            with contextlib.suppress(ConnectionClosed):
                while True:
                    message = MSGPACK.decode_server(await socket.recv())
                    self.heard.append((time.monotonic(), message.type))
                    for row in rows_of(message):
                        file.write(json.dumps(row) + "\n")
                    if isinstance(message, messages.Snapshot):
                        self.joined.set()
        self.ended.set()

    def close(self) -> None:
        """Complete the evidence."""
        with self.file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(["over", None, "listeners receive no outcome"]) + "\n")


@asynccontextmanager
async def listening_to(
    url: str, codes: Iterable[tuple[str, str]], evidence: Path
) -> AsyncIterator[list[Listener]]:
    """Watch episodes of a node.

    Args:
        url: The address of the node.
        codes: The ids and codes of the episodes.
        evidence: The folder for the evidence.
    """
    made: list[Listener] = []
    async with AsyncExitStack() as stack:
        tasks = []
        for episode, code in codes:
            # The number distinguishes the listeners of several drills.
            file = evidence / f"{episode}-eye-listener{time.monotonic_ns()}.jsonl"
            opening = connect(
                url, subprotocols=[Subprotocol(MSGPACK.name)], compression=None,
                ping_interval=None, close_timeout=0.1,
            )  # fmt: skip
            socket = await stack.enter_async_context(opening)
            made.append(Listener(episode, code, file))
            tasks.append(asyncio.create_task(made[-1].listen(socket)))
        for listener in made:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(listener.joined.wait(), JOIN_SECONDS)
        try:
            yield [listener for listener in made if listener.joined.is_set()]
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            for listener in made:
                listener.close()
