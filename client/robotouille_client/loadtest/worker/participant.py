"""One bot's connection: it introduces itself, takes a seat, and takes it again when it was cut."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass, field
from typing import Any

import msgpack
from websockets.uri import WebSocketURI

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.messages import PROTOCOL_VERSION
from robotouille_client.loadtest.histogram import Measurements
from robotouille_client.loadtest.worker.light_connection import (
    LightConnection,
    Traffic,
    open_connection,
)
from robotouille_client.sansio.addresses import moved_url
from robotouille_client.sansio.backoff import pauses
from robotouille_client.sockets import server_uri

__all__ = ["Environment", "LostError", "Participant"]

ANSWER_SECONDS = 30.0

Message = dict[str, Any]


class LostError(RobotouilleError):
    """The connection was lost while an answer was waited for."""


@dataclass
class Environment:
    """What all participants of a process share."""

    uri: WebSocketURI
    token: str | None = None
    rng: random.Random = field(default_factory=random.Random)
    traffic: Traffic = field(default_factory=Traffic)
    measured: Measurements = field(default_factory=Measurements)
    connected: int = 0
    transit: float = 0.0
    """Seconds of the shortest way from the server to here."""


class Participant:
    """A named bot. What comes in goes to `heard`, except answers that somebody waits for."""

    def __init__(self, environment: Environment, name: str) -> None:
        self.environment = environment
        self.name = name
        self.connection: LightConnection | None = None
        self.seat: str | None = None
        self.closing = False
        self._uri = environment.uri
        self._resume: str | None = None
        self._seen: Message | None = None
        self._awaited: list[tuple[tuple[str, ...], asyncio.Future[Message]]] = []

    def saw(self, episode: str | None, step: int) -> None:
        """Up to which step this bot has followed an episode; it is told when it comes back."""
        self._seen = {"episode": episode, "step": step} if episode is not None else None

    # For subclasses

    def heard(self, message: Message) -> None:
        """A message came that is no awaited answer."""

    def seated(self, joined: Message) -> None:
        """The server has let this bot in, for the first time or again."""

    def interrupted(self) -> None:
        """The server or the network has ended the connection."""

    # Connecting

    async def introduce(self) -> Message:
        """Open a connection and say hello; the server's `welcome`."""
        environment = self.environment
        connection = await open_connection(self._uri, environment.traffic, ANSWER_SECONDS)
        self.connection = connection
        connection.receive = self._receive
        connection.lost = self._lost
        environment.connected += 1
        hello: Message = {
            "type": "hello", "protocol": PROTOCOL_VERSION, "name": self.name, "kind": "bot",
        }  # fmt: skip
        if environment.token is not None:
            hello["token"] = environment.token
        if self._resume is not None:
            hello["resume"] = self._resume
            if self._seen is not None:
                hello["seen"] = self._seen
        welcome = await self.ask(hello, "welcome", "moved")
        if welcome["type"] == "moved":
            return await self._move(welcome)
        self._resume = welcome["resume"]
        return welcome

    async def enter(self, code: str, role: str = "player", known: tuple[str, ...] = ()) -> Message:
        """Join an episode, at whichever of the server's processes it is; the answer `joined`."""
        join = {"type": "join", "episode": code, "role": role, "known": list(known)}
        joined = await self.ask(join, "joined", "moved")
        if joined["type"] == "moved":
            self._resume = None
            await self._move(joined)
            joined = await self.ask(join, "joined")
        return joined

    async def return_to_seat(self) -> Message:
        """Come back after a lost connection, however often that takes; the answer `joined`.

        ProtocolError where the server does not let us.
        """
        waits = pauses(self.environment.rng)
        while True:
            await asyncio.sleep(next(waits))
            try:
                return await self._resumed()
            except ProtocolError:
                raise
            except RobotouilleError:
                self.environment.measured.count("failed attempts to return")
                self.cut()

    async def _resumed(self) -> Message:
        seated = self._expect("joined", "moved")
        try:
            await self.introduce()
            joined = await _within(ANSWER_SECONDS, seated)
            if joined["type"] == "moved":
                seated = self._expect("joined")
                await self._move(joined)
                joined = await _within(ANSWER_SECONDS, seated)
        finally:
            self._awaited.clear()
        return joined

    async def _move(self, moved: Message) -> Message:
        """The episode is with another process of the server: connect there."""
        self._drop()
        host = f"[{self._uri.host}]" if ":" in self._uri.host else self._uri.host
        scheme = "wss" if self._uri.secure else "ws"
        here = f"{scheme}://{host}:{self._uri.port}"
        self._uri = server_uri(moved_url(here, messages.Moved.model_validate(moved)))
        return await self.introduce()

    def cut(self) -> None:
        """Lose the connection, without a word to the server."""
        self._drop()

    def close(self) -> None:
        """Leave for good."""
        self.closing = True
        self._drop(politely=True)

    def _drop(self, politely: bool = False) -> None:
        connection, self.connection = self.connection, None
        if connection is None:
            return
        self.environment.connected -= 1
        connection.lost = _nothing
        connection.receive = _ignore
        if politely:
            connection.close()
        else:
            connection.abort()

    def _lost(self) -> None:
        self._drop()
        self._fail(LostError("the connection was lost"))
        if not self.closing:
            self.environment.measured.count("connections lost")
            self.interrupted()

    # Talking

    def send(self, message: Message) -> None:
        if self.connection is not None:
            self.connection.send(message)

    async def ask(self, message: Message, *kinds: str) -> Message:
        """Send a request and wait for an answer of one of these types."""
        self.send(message)
        return await self.answer(*kinds)

    async def answer(self, *kinds: str) -> Message:
        """Wait for a message of one of these types.

        ProtocolError if the server refuses, LostError if the connection ends or nothing comes.
        """
        if self.connection is None:
            raise LostError("the connection was lost")
        return await _within(ANSWER_SECONDS, self._expect(*kinds))

    def _expect(self, *kinds: str) -> asyncio.Future[Message]:
        future: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._awaited.append((kinds, future))
        return future

    def _receive(self, payload: bytes) -> None:
        message: Message = msgpack.unpackb(payload)
        kind = message["type"]
        if kind == "joined":
            self.seat = message.get("seat")
            self._resume = message.get("resume") or self._resume
            self.seated(message)
        if kind in ("error", "bye"):
            self._refused(message)
        elif not self._awaited or not self._answered(kind, message):
            self.heard(message)

    def _answered(self, kind: str, message: Message) -> bool:
        for entry in self._awaited:
            kinds, future = entry
            if kind in kinds:
                self._awaited.remove(entry)
                if not future.done():
                    future.set_result(message)
                return True
        return False

    def _refused(self, message: Message) -> None:
        code = message.get("code") or message["type"]
        text = message.get("message") or message.get("reason") or ""
        retry = message.get("retry", False)
        if not self._fail(LostError(text) if retry else ProtocolError(code, text)):
            self.environment.measured.count(f"refused: {code}")

    def _fail(self, error: RobotouilleError) -> bool:
        """Tell whoever waits for an answer that none will come; False if nobody does."""
        waiting, self._awaited = self._awaited, []
        for _, future in waiting:
            if not future.done():
                future.set_exception(error)
                future.exception()
        return bool(waiting)


async def _within(seconds: float, future: asyncio.Future[Message]) -> Message:
    try:
        async with asyncio.timeout(seconds):
            return await future
    except TimeoutError:
        raise LostError(f"no answer came in {seconds:g} s") from None


def _ignore(payload: bytes) -> None:
    del payload


def _nothing() -> None:
    pass
