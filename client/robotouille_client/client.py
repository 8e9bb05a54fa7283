"""`connect()`: the async client library. It reconnects by itself; a bot's code does not notice."""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import (
    ConnectionClosed,
    InvalidHandshake,
    InvalidURI,
)
from websockets.typing import Subprotocol

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille_client.addresses import moved_url, open_socket, why_not
from robotouille_client.backoff import pauses
from robotouille_client.errors import (
    ConnectionFailedError,
    MovedError,
    NotYetError,
    StrangerError,
)
from robotouille_client.game import Game

__all__ = ["Client", "ConnectionFailedError", "connect"]

DEFAULT_URL = "ws://127.0.0.1:8765"
ANSWER_SECONDS = 15.0
REPEAT_SECONDS = 5.0
"""After which an action without an answer is sent again; it acts once all the same."""
AGAIN_SECONDS = 0.5
"""After which a request is sent again that the server asked us to repeat."""
MAX_MOVES = 4

LOST_TOKEN = ("auth/expired", "auth/invalid", "auth/required", "auth/revoked")
TRY_AGAIN = "server/handover"
TEMPORARY = (TRY_AGAIN, "server/recording", "rate/limited")

T = TypeVar("T", bound=messages.Message)


class Client:
    """A participant's connection to a server; made by `connect()`.

    A lost connection is sought again with growing pauses, and taken up where it was cut: what was
    missed comes in, and requests and actions without an answer are sent again.
    """

    def __init__(
        self,
        url: str,
        *,
        name: str,
        kind: messages.Kind = "bot",
        codec: Codec = MSGPACK,
        reconnect: bool = True,
        seed: int | None = None,
        token: str | None = None,
        resume: str | None = None,
    ) -> None:
        self.url = url
        self.name = name
        self.role = ""
        self.kind: messages.Kind = kind
        self.game: Game | None = None
        self.connected = asyncio.Event()
        self._codec = codec
        self._reconnect = reconnect
        self._jitter = random.Random(seed)
        self._socket: ClientConnection | None = None
        self._token = token
        self._resume = resume
        self._refs = 0
        self._answers: dict[int, asyncio.Future[Any]] = {}
        self._requests: dict[int, Any] = {}
        self._sent: set[int | None] = set()
        self._join: messages.Join | None = None
        self._rejoin: int | None = None
        self._again: messages.Join | None = None
        self._moved: asyncio.Task[None] | None = None
        self._joining: int | None = None
        self._pending_join: messages.Joined | None = None
        self._painted = False
        self._reader: asyncio.Task[None] | None = None
        self._outbox: asyncio.Queue[messages.Message] = asyncio.Queue()
        self._unsent: messages.Message | None = None
        self._repeater: asyncio.TimerHandle | None = None
        self._up_since = 0.0
        self._closing = False
        self._moving = False
        self.farewell = ""

    @property
    def resume(self) -> str | None:
        """Brings this connection back, from another process too; another one after each use."""
        return self._resume

    # Life

    async def __aenter__(self) -> Self:
        await self._open_somewhere()
        self._reader = asyncio.create_task(self._run(), name=f"robotouille-client {self.name}")
        self._repeat()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connection; a seat is kept for the server's grace period."""
        self._closing = True
        if self._repeater is not None:
            self._repeater.cancel()
        if self._reader is not None:
            self._reader.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._reader
        if self._socket is not None:
            await self._socket.close()

    # Requests

    async def episodes(self) -> list[messages.EpisodeInfo]:
        """The episodes on the server."""
        answer = await self._ask(messages.ListEpisodes(ref=self._next_ref()), messages.Episodes)
        return answer.episodes

    async def create(self, task: str | None = None, **options: Any) -> messages.Created:
        """Open an episode; `options` are the fields of the `create` message."""
        request = messages.Create(ref=self._next_ref(), task=task, **options)
        return await self._ask(request, messages.Created)

    async def join(
        self,
        episode: str,
        *,
        seat: str | None = None,
        role: Literal["player", "spectator"] = "player",
        view: messages.View = "state",
    ) -> Game:
        """Enter an episode by id or code; returns once the first picture is there."""
        for _ in range(MAX_MOVES):
            request = messages.Join(
                ref=self._next_ref(), episode=episode, seat=seat, role=role, view=view
            )
            try:
                await self._ask(request, messages.Joined)
                break
            except MovedError as error:
                await self._move(error.moved)
        else:
            raise ConnectionFailedError(f"{self.url} sends us from one process to the next")
        self._join = request
        if self.game is None:
            raise AssertionError("joined without a game")
        return self.game

    async def leave(self) -> None:
        """Leave the episode; the seat becomes free."""
        self._join = None
        await self._ask(messages.Leave(ref=self._next_ref()), messages.Left)
        self.game = None

    async def _move(self, moved: messages.Moved) -> None:
        """Go to the process that has the episode."""
        self.url, self._resume = moved_url(self.url, moved), None
        self.connected.clear()
        self._moving = True
        if self._socket is not None:
            await self._socket.close()
        arrived = asyncio.ensure_future(self.connected.wait())
        waiting = {arrived, self._reader} if self._reader is not None else {arrived}
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        arrived.cancel()
        if not self.connected.is_set():
            reason = self.farewell or "it cannot be reached"
            raise ConnectionFailedError(f"{self.url}, where the episode is: {reason}")

    def _next_ref(self) -> int:
        self._refs += 1
        return self._refs

    async def _ask(self, request: Any, expected: type[T]) -> T:
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self._answers[request.ref] = future
        self._requests[request.ref] = request
        self._send(request)
        try:
            answer = await self._answered(future)
        finally:
            self._answers.pop(request.ref, None)
            self._requests.pop(request.ref, None)
            self._sent.discard(request.ref)
        if not isinstance(answer, expected):
            found = type(answer).__name__
            raise ProtocolError("message/unexpected", f"{found} in answer to {request.type}")
        return answer

    async def _answered(self, future: asyncio.Future[T]) -> T:
        """An answer; only the time for which there is a connection counts."""
        loop = asyncio.get_running_loop()
        waiting: set[asyncio.Future[Any]] = {future}
        if self._reader is not None:
            waiting.add(self._reader)
        while True:
            await asyncio.wait(waiting, timeout=ANSWER_SECONDS, return_when=asyncio.FIRST_COMPLETED)
            if future.done():
                return future.result()
            if self._reader is not None and self._reader.done():
                future.cancel()
                reason = self.farewell or "the connection was closed"
                raise ConnectionFailedError(f"{self.url}: {reason}")
            if self.connected.is_set() and loop.time() - self._up_since >= ANSWER_SECONDS:
                future.cancel()
                raise ConnectionFailedError(f"{self.url} does not answer")

    def _send(self, message: messages.Message) -> None:
        self._outbox.put_nowait(message)

    # The connection

    async def _open_somewhere(self) -> None:
        """Connect, to another process of the server if we are sent there."""
        for _ in range(MAX_MOVES):
            try:
                await self._open()
                return
            except MovedError as error:
                self.url = moved_url(self.url, error.moved)
        raise ConnectionFailedError(f"{self.url} sends us from one process to the next")

    async def _open(self) -> None:
        """Connect and say hello."""
        socket = await self._connect()
        try:
            async with asyncio.timeout(ANSWER_SECONDS):
                answer = await self._greet(socket)
            await self._take_up(socket, answer)
        except (ConnectionClosed, TimeoutError) as error:
            await socket.close()
            raise ConnectionFailedError(f"{self.url} did not welcome us: {error}") from None
        except BaseException:
            await socket.close()
            raise
        self._socket = socket
        self._resume = answer.resume
        self.role = answer.role
        self._up_since = asyncio.get_running_loop().time()
        self.connected.set()

    async def _take_up(self, socket: ClientConnection, welcome: messages.Welcome) -> None:
        """Ask again what was not answered, and join again where the server has forgotten us."""
        self._rejoin = None
        join = self._join or self._joined_without_asking()
        if join is not None and not welcome.resumed:
            await self._join_again(socket, join)
        for ref in list(self._requests):
            if ref in self._sent and not isinstance(self._requests[ref], messages.Create):
                await socket.send(self._codec.encode(self._requests[ref]))

    async def _connect(self) -> ClientConnection:
        try:
            return await open_socket(
                self.url,
                subprotocols=[Subprotocol(self._codec.name)],
                compression=None,
                max_size=8 * 1024 * 1024,
                open_timeout=10,
                ping_interval=20,
                ping_timeout=60,
                close_timeout=2,
            )
        except (OSError, InvalidHandshake, InvalidURI, TimeoutError) as error:
            raise ConnectionFailedError(
                f"cannot connect to {self.url}: {why_not(error, self.url)}"
            ) from None

    async def _greet(self, socket: ClientConnection) -> messages.Welcome:
        """Say hello, anew where the resume token has expired."""
        hello = messages.Hello(
            protocol=messages.PROTOCOL_VERSION,
            name=self.name,
            kind=self.kind,
            token=None if self._resume else self._token,
            resume=self._resume,
            seen=self.game.seen if self._resume and self.game is not None else None,
            view=self._view() if self._resume else None,
        )
        await socket.send(self._codec.encode(hello))
        answer = await self._first_answer(socket)
        if isinstance(answer, messages.Error) and self._resume and answer.code in LOST_TOKEN:
            self._resume = None
            anew = {"resume": None, "seen": None, "view": None, "token": self._token}
            await socket.send(self._codec.encode(hello.model_copy(update=anew)))
            answer = await self._first_answer(socket)
        if isinstance(answer, messages.Error):
            if answer.code == TRY_AGAIN:
                raise NotYetError(answer.message)
            raise ProtocolError(answer.code, answer.message, answer.field)
        if isinstance(answer, messages.Moved):
            raise MovedError(answer)
        if isinstance(answer, messages.Bye):
            if answer.retry:
                raise NotYetError(answer.reason)
            raise ProtocolError(answer.code, answer.reason)
        if not isinstance(answer, messages.Welcome):
            found = type(answer).__name__
            raise NotYetError(f"{found} in answer to hello")
        return answer

    def _view(self) -> messages.View | None:
        """The view that we have asked for, whether or not that was answered."""
        asked = self._asked(messages.Join)
        join = self._join if asked is None else self._requests[asked]
        return join.view if join is not None else None

    async def _first_answer(self, socket: ClientConnection) -> messages.ServerMessage:
        return self._codec.decode_server(await socket.recv())

    def _joined_without_asking(self) -> messages.Join | None:
        """What would bring us into a game that a resume token alone has brought us into."""
        game = self.game
        if game is None or game.ended:
            return None
        role: Literal["player", "spectator"] = "player" if game.seat else "spectator"
        view: messages.View = "state" if game.has_state else "text"
        return messages.Join(episode=game.episode, role=role, seat=game.seat, view=view)

    async def _join_again(self, socket: ClientConnection, join: messages.Join) -> None:
        """The server forgot us: take the same seat as a newcomer."""
        seat = self.game.seat if self.game else join.seat
        self._rejoin = self._next_ref()
        self._again = join.model_copy(update={"ref": self._rejoin, "seat": seat})
        await socket.send(self._codec.encode(self._again))

    async def _run(self) -> None:
        try:
            while not self._closing:
                await self._converse()
                self.connected.clear()
                if self._closing or self.farewell or not (self._reconnect or self._moving):
                    break
                await self._come_back()
                self._moving = False
        except RobotouilleError as error:
            self.farewell = f"the server's messages cannot be read: {error}"
        finally:
            self._give_up(self.farewell or "the connection was closed")

    async def _converse(self) -> None:
        socket = self._socket
        if socket is None:
            return
        sender = asyncio.create_task(self._write(socket))
        try:
            async for payload in socket:
                self._receive(self._codec.decode_server(payload))
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sender

    async def _write(self, socket: ClientConnection) -> None:
        while True:
            if self._unsent is None:
                self._unsent = await self._outbox.get()
            if isinstance(self._unsent, messages.Act) and not self._awaited(self._unsent):
                self._unsent = None
                continue
            try:
                await socket.send(self._codec.encode(self._unsent))
                self._sent.add(getattr(self._unsent, "ref", None))
            except ConnectionClosed:
                return
            self._unsent = None

    def _awaited(self, act: messages.Act) -> bool:
        """Whether an action is still wanted: its game, and our seat in it, may be lost."""
        return self._rejoin is None and self.game is not None and self.game.awaits(act)

    async def _come_back(self) -> None:
        """Reconnect with growing pauses (100 ms to 5 s, with jitter)."""
        waits = pauses(self._jitter)
        while not self._closing:
            await asyncio.sleep(next(waits))
            try:
                await self._open_somewhere()
            except ConnectionFailedError as error:
                if not self._reconnect or isinstance(error, StrangerError):
                    self.farewell = str(error)
                    return
                continue
            except (ProtocolError, ConnectionClosed) as error:
                self.farewell = str(error)
            return

    def _repeat(self) -> None:
        """Now and then, send again what has no answer."""
        loop = asyncio.get_running_loop()
        self._repeater = loop.call_later(REPEAT_SECONDS, self._repeat)
        if self.game is not None and self.connected.is_set():
            self.game.repeat(loop.time() - REPEAT_SECONDS)

    def _receive(self, message: messages.ServerMessage) -> None:
        now = asyncio.get_running_loop().time()
        if isinstance(message, messages.Joined):
            self._joined(message)
        if isinstance(message, messages.Bye):
            if message.retry:
                return
            self.farewell = message.reason
        if isinstance(message, messages.Left):
            self._join = None
        if self.game is not None:
            self.game.receive(message, now)
        self._settle(message)

    def _joined(self, message: messages.Joined) -> None:
        if message.resume is not None:
            self._resume = message.resume
        game, asked = self.game, message.ref in self._requests
        if game is None or game.episode != message.episode or game.ended or asked:
            self.game = Game(self._send, message)
        else:
            game.rejoined(message, anew=message.ref is not None)
        self._rejoin = None
        self._pending_join = message

    def _settle(self, message: messages.ServerMessage) -> None:
        """Hand an answer to who asked; a join is answered once its first picture is there."""
        ref = getattr(message, "ref", None)
        done = False
        if isinstance(message, messages.Error):
            message = self._done_before(message)
            done = isinstance(message, messages.Joined) and self._painted
        if ref is not None and ref == self._rejoin:
            self._rejoining(message)
        if isinstance(message, messages.Joined) and not done:
            self._painted = False
            self._joining = ref if ref is not None else self._asked(messages.Join)
            return
        if isinstance(message, messages.Snapshot | messages.Observation):
            self._painted = True
            ref, message = self._joining, self._pending_join  # type: ignore[assignment]
            self._joining = None
        future = self._answers.get(ref) if ref is not None else None
        if future is None or future.done():
            return
        if isinstance(message, messages.Error) and message.code == TRY_AGAIN and ref is not None:
            asyncio.get_running_loop().call_later(AGAIN_SECONDS, self._ask_again, ref)
            return
        if isinstance(message, messages.Error):
            future.set_exception(ProtocolError(message.code, message.message, message.field))
        elif isinstance(message, messages.Moved):
            future.set_exception(MovedError(message))
        else:
            future.set_result(message)

    def _rejoining(self, answer: messages.ServerMessage) -> None:
        """Our place was lost, and it is not simply given back."""
        if isinstance(answer, messages.Moved) and self._socket is not None:
            try:
                self.url, self._resume, self._moving = moved_url(self.url, answer), None, True
            except StrangerError as error:
                self.farewell = str(error)
            self._moved = asyncio.create_task(self._socket.close())
        elif isinstance(answer, messages.Error) and answer.code in TEMPORARY:
            again = asyncio.get_running_loop().call_later
            again(AGAIN_SECONDS, self._join_once_more, self._rejoin)
        elif isinstance(answer, messages.Error):
            self._join = self._rejoin = None
            if self.game is not None:
                lost = messages.Left(episode=self.game.episode, reason=answer.message)
                self.game.receive(lost, 0.0)

    def _join_once_more(self, ref: int | None) -> None:
        if ref is not None and ref == self._rejoin and self._again is not None:
            self._send(self._again)

    def _ask_again(self, ref: int) -> None:
        """The server could not answer in that moment, but another process soon can."""
        if ref in self._requests and not self._closing:
            self._send(self._requests[ref])

    def _asked(self, kind: type[messages.Message]) -> int | None:
        """The reference of a request of this kind that waits for its answer."""
        return next((r for r, request in self._requests.items() if isinstance(request, kind)), None)

    def _done_before(self, error: messages.Error) -> messages.ServerMessage:
        """A request that was sent twice since its first answer was lost: it has been done."""
        request = self._requests.get(error.ref) if error.ref is not None else None
        if isinstance(request, messages.Leave) and error.code == "episode/none":
            return messages.Left(ref=error.ref, episode=self.game.episode if self.game else "-")
        joined = self._pending_join
        if isinstance(request, messages.Join) and error.code == "episode/joined" and joined:
            asked = request.episode.replace("-", "").upper()
            if asked in (joined.episode.upper(), joined.code.replace("-", "").upper()):
                return joined
        return error

    def _give_up(self, reason: str) -> None:
        for future in self._answers.values():
            if not future.done():
                future.set_exception(ConnectionFailedError(reason))
        if self.game is not None and not self.game.over:
            self.game.receive(messages.Bye(reason=reason), 0.0)


@asynccontextmanager
async def connect(
    url: str = DEFAULT_URL,
    *,
    name: str,
    kind: messages.Kind = "bot",
    encoding: Literal["msgpack", "json"] = "msgpack",
    reconnect: bool = True,
    token: str | None = None,
    resume: str | None = None,
    seed: int | None = None,
) -> AsyncIterator[Client]:
    """A connection to a server; `token` is a signed role token, `seed` that of the pauses' jitter.
    `resume` is the `Client.resume` of a process that stopped: `join` of its episode then gives
    back its seat.

    Raises ConnectionFailedError if it cannot be reached at first; later it is sought again and
    again until the context is left.
    """
    codec = MSGPACK if encoding == "msgpack" else JSON
    async with Client(
        url,
        name=name,
        kind=kind,
        codec=codec,
        reconnect=reconnect,
        token=token,
        resume=resume,
        seed=seed,
    ) as client:
        yield client
