"""A bot's session: hello, join, and the return after a lost connection."""

from __future__ import annotations

import asyncio
import random
from dataclasses import dataclass, field
from typing import Any

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.codec import MSGPACK
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.messages import PROTOCOL_VERSION
from robotouille_client.loadtest.histogram import Measurements
from robotouille_client.loadtest.incoming import check_message
from robotouille_client.loadtest.light_connection import (
    LightConnection,
    Traffic,
    open_connection,
)
from robotouille_client.sansio.attempts import ServerAddresses
from robotouille_client.sockets import server_uri

ANSWER_SECONDS = 30.0
MAX_MOVES = 4
"""Number of redirects in a row after which an attempt has failed."""

RawMessage = dict[str, Any]


class LostError(RobotouilleError):
    """The connection was lost before an answer arrived."""


@dataclass
class Environment:
    """State that all participants of a process share. `url` may name several nodes."""

    url: str
    token: str | None = None
    rng: random.Random = field(default_factory=random.Random)
    traffic: Traffic = field(default_factory=Traffic)
    measured: Measurements = field(default_factory=Measurements)
    connected: int = 0
    transit: float = 0.0
    """Shortest time in seconds that a message took from the server to this process."""


class Participant:
    """A named bot. Messages go to `heard`, except for awaited answers."""

    def __init__(self, environment: Environment, name: str) -> None:
        self.environment = environment
        self.name = name
        self.connection: LightConnection | None = None
        self.seat: str | None = None
        self.closing = False
        self._addresses = ServerAddresses(environment.url, environment.rng)
        self._redirected = False
        self._resume: str | None = None
        self._seen: RawMessage | None = None
        self._awaited: list[tuple[tuple[str, ...], asyncio.Future[RawMessage]]] = []

    def saw(self, episode: str | None, step: int) -> None:
        """Set the last seen step of an episode, which the bot reports when it returns."""
        self._seen = {"episode": episode, "step": step} if episode is not None else None

    # Overridden by subclasses

    def heard(self, message: RawMessage) -> None:
        """Handle a message that is not an awaited answer."""

    def seated(self, joined: RawMessage) -> None:
        """Handle the answer to a join, the first one or after a return."""

    def interrupted(self) -> None:
        """Handle the loss of the connection."""

    # Connecting

    async def introduce(self) -> RawMessage:
        """Open a connection to the first node that answers, and return its `welcome`."""
        while True:
            try:
                return await self._introduce()
            except ProtocolError:
                raise
            except RobotouilleError:
                if not self._addresses.left:
                    raise
                self.cut()
                self._addresses.failed()

    async def _introduce(self, moves: int = 0) -> RawMessage:
        environment, addresses = self.environment, self._addresses
        seconds = addresses.connect_seconds if addresses.others else ANSWER_SECONDS
        uri = server_uri(addresses.current)
        connection = await open_connection(uri, environment.traffic, seconds)
        self.connection = connection
        connection.receive = self._receive
        connection.lost = self._lost
        environment.connected += 1
        hello: RawMessage = {
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
            return await self._greet_elsewhere(welcome, moves + 1)
        addresses.reached(welcome.get("nodes", ()))
        self._resume = welcome["resume"]
        return welcome

    async def _greet_elsewhere(self, moved: RawMessage, moves: int) -> RawMessage:
        self._drop()
        url = self._url_of(moved)
        if moves >= MAX_MOVES or not self._addresses.redirect_within_round(url):
            raise LostError(f"{self._addresses.current} redirects to {url} in vain")
        return await self._introduce(moves)

    def _url_of(self, moved: RawMessage) -> str:
        return self._addresses.resolve(messages.Moved.model_validate(moved))

    async def enter(
        self, code: str, role: str = "player", known: tuple[str, ...] = ()
    ) -> RawMessage:
        """Join an episode, following a redirect to its process, and return the `joined`."""
        join = {"type": "join", "episode": code, "role": role, "known": list(known)}
        joined = await self.ask(join, "joined", "moved")
        if joined["type"] == "moved":
            self._resume = None
            await self._move(joined)
            joined = await self.ask(join, "joined")
        return joined

    async def return_to_seat(self) -> RawMessage:
        """Return after a lost connection, with as many attempts as needed.

        Raises:
            ProtocolError: The server refuses.
        """
        delay = 0.0 if self._redirected else self._addresses.lost()
        self._redirected = False
        while True:
            await asyncio.sleep(delay)
            try:
                return await self._resumed()
            except RobotouilleError as error:
                if isinstance(error, ProtocolError) and error.code != ErrorCode.SERVER_HANDOVER:
                    raise
                self.environment.measured.count("failed attempts to return")
                self.cut()
                delay = self._addresses.failed()

    async def _resumed(self) -> RawMessage:
        seated = self._expect("joined", "moved")
        try:
            await self._introduce()
            joined = await _within(ANSWER_SECONDS, seated)
            if joined["type"] == "moved":
                seated = self._expect("joined")
                await self._move(joined)
                joined = await _within(ANSWER_SECONDS, seated)
        finally:
            self._awaited.clear()
        return joined

    async def _move(self, moved: RawMessage) -> RawMessage:
        self._drop()
        self._addresses.redirect(self._url_of(moved))
        return await self._introduce()

    def _moved_on(self, moved: RawMessage) -> None:
        """Return to the episode, which continues on another node."""
        try:
            self._addresses.redirect(self._url_of(moved))
            self._redirected = True
        except RobotouilleError:
            self.environment.measured.count("moves to untrusted addresses")
        self._lost()

    def cut(self) -> None:
        """Cut the connection without a closing handshake."""
        self._drop()

    def close(self) -> None:
        """Close the connection for good."""
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

    # Requests

    def send(self, message: RawMessage) -> None:
        if self.connection is not None:
            self.connection.send(message)

    async def ask(self, message: RawMessage, *kinds: str) -> RawMessage:
        """Send a request and wait for an answer of one of these types."""
        self.send(message)
        return await self.answer(*kinds)

    async def answer(self, *kinds: str) -> RawMessage:
        """Wait for a message of one of these types.

        Raises:
            ProtocolError: The server refuses.
            LostError: The connection ends, or no answer arrives in time.
        """
        if self.connection is None:
            raise LostError("the connection was lost")
        return await _within(ANSWER_SECONDS, self._expect(*kinds))

    def _expect(self, *kinds: str) -> asyncio.Future[RawMessage]:
        future: asyncio.Future[RawMessage] = asyncio.get_running_loop().create_future()
        self._awaited.append((kinds, future))
        return future

    def _receive(self, payload: bytes) -> None:
        try:
            self._take(payload)
        except Exception as error:
            # The server can send anything, which fails in as many ways.
            self.environment.measured.count("invalid messages")
            reason = str(error).partition("\n")[0]
            self._fail(LostError(f"the server sent an invalid message: {reason}"))
            if self.connection is not None:
                self.connection.receive = _ignore
                self.connection.abort()

    def _take(self, payload: bytes) -> None:
        message: RawMessage = MSGPACK.unpack_server(payload)
        kind = message["type"]
        check_message(message)
        if kind == "joined":
            self.seat = message.get("seat")
            self._resume = message.get("resume") or self._resume
            self._addresses.answered()
            self.seated(message)
        if kind in ("error", "bye"):
            self._refused(message)
        elif self._awaited and self._answered(kind, message):
            pass
        elif kind == "moved":
            self._moved_on(message)
        else:
            self.heard(message)

    def _answered(self, kind: str, message: RawMessage) -> bool:
        for entry in self._awaited:
            kinds, future = entry
            if kind in kinds:
                self._awaited.remove(entry)
                if not future.done():
                    future.set_result(message)
                return True
        return False

    def _refused(self, message: RawMessage) -> None:
        code = message.get("code") or message["type"]
        text = message.get("message") or message.get("reason") or ""
        retry = message.get("retry", False)
        if not self._fail(LostError(text) if retry else ProtocolError(code, text)):
            self.environment.measured.count(f"refused: {code}")

    def _fail(self, error: RobotouilleError) -> bool:
        waiting, self._awaited = self._awaited, []
        for _, future in waiting:
            if not future.done():
                future.set_exception(error)
                future.exception()
        return bool(waiting)


async def _within(seconds: float, future: asyncio.Future[RawMessage]) -> RawMessage:
    try:
        async with asyncio.timeout(seconds):
            return await future
    except TimeoutError:
        raise LostError(f"no answer within {seconds:g} s") from None


def _ignore(payload: bytes) -> None:
    del payload


def _nothing() -> None:
    pass
