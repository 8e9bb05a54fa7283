"""`connect()`: the async client library. It reconnects by itself; a bot's code does not notice.

What to send and when is decided in `client_protocol`; here are the socket, futures and timers.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidURI
from websockets.typing import Subprotocol

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.error_codes import ErrorCode
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.game import Game
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.client_requests import Request, RequestDone
from robotouille_client.sansio.client_state import ClientState
from robotouille_client.sockets import open_socket, server_uri, why_not

__all__ = ["Client", "connect"]

DEFAULT_URL = "ws://127.0.0.1:8765"

T = TypeVar("T", bound=messages.Message)


class Client:
    """A participant's connection to a server; made by `connect()`.

    `connected` is set while there is a connection on which the server has welcomed us.
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
        self.connected = asyncio.Event()
        self.protocol = ClientProtocol(
            lambda joined: Game(joined, self._flush),
            url=url,
            name=name,
            kind=kind,
            reconnect=reconnect,
            token=token,
            resume=resume,
            rng=random.Random(seed),
        )
        self._codec = codec
        self._socket: ClientConnection | None = None
        self._runner: asyncio.Task[None] | None = None
        self._answers: dict[int, asyncio.Future[messages.ServerMessage]] = {}
        self._game: Game | None = None
        self._to_send = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None

    @property
    def url(self) -> str:
        """The process of the server that one is connected to."""
        return self.protocol.url

    @url.setter
    def url(self, url: str) -> None:
        self.protocol.url = url

    @property
    def name(self) -> str:
        """What one wants to be called."""
        return self.protocol.name

    @property
    def role(self) -> str:
        """What one may do: operator, host, player or spectator."""
        return self.protocol.role

    @property
    def game(self) -> Game | None:
        """The episode that one is in."""
        return self.protocol.game

    @property
    def farewell(self) -> str:
        """Why the connection ended for good; empty while it has not."""
        return self.protocol.farewell

    @property
    def resume(self) -> str | None:
        """Brings this connection back, from another process too; another one after each use."""
        return self.protocol.resume

    @property
    def resumed(self) -> bool:
        """Whether the server took the last connection for the one before it."""
        return self.protocol.resumed

    # Life

    async def __aenter__(self) -> Self:
        self._runner = asyncio.create_task(self._run(), name=f"robotouille-client {self.name}")
        welcome = asyncio.create_task(self.connected.wait())
        try:
            await asyncio.wait({welcome, self._runner}, return_when=asyncio.FIRST_COMPLETED)
            if not self.protocol.welcomed:
                await self._runner
                raise self.protocol.error or ConnectionFailedError(f"{self.url}: {self.farewell}")
        except BaseException:
            await self.close()
            raise
        finally:
            welcome.cancel()
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
        self.protocol.close()
        self._flush()
        if self._runner is not None:
            self._runner.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._runner

    # Requests

    async def episodes(
        self, labels: Mapping[str, str] | None = None, *, closed: bool = False
    ) -> list[messages.EpisodeInfo]:
        """The episodes on the server that can be joined or watched.

        Args:
            labels: Only those that have all of these; hosts see those of their own episodes.
            closed: Those instead that were closed because nobody came.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: The server refuses; `code` says why.
        """
        found: dict[str, messages.EpisodeInfo] = {}
        request = messages.ListEpisodes(labels=dict(labels or {}), closed=closed)
        while True:
            page = await self._ask(request, messages.Episodes)
            found.update((one.episode, one) for one in page.episodes)
            skip = request.skip + len(page.episodes)
            if not page.episodes or skip >= page.total:
                return list(found.values())
            request = request.model_copy(update={"skip": skip})

    async def waiting_episode(self) -> messages.EpisodeInfo | None:
        """The first episode that waits for players, if there is one.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: The server refuses; `code` says why.
        """
        return next((each for each in await self.episodes() if each.phase == "waiting"), None)

    async def create(self, task: str | None = None, **options: Any) -> messages.Created:
        """Open an episode, without entering it: `join` takes the id or code in the answer.

        Args:
            task: A shipped task's name, or an unambiguous start of it; the server's own if None.
            **options: The fields of the `create` message (docs/protocol.md).

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: The server refuses: `task/unknown`, `task/invalid`, `server/full` and
                others.
            ValueError: The message has no such field, or it cannot have this value.
        """
        return await self._ask(messages.Create(task=task, **options), messages.Created)

    async def close_episode(self, episode: str, reason: str | None = None) -> messages.Closed:
        """Close an episode, by id or code, that one has opened; an operator closes any.

        Args:
            reason: What those in it are told.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: The server refuses: `episode/unknown`, `auth/episode` and others.
            ValueError: An argument is none that the message can have.
        """
        return await self._ask(messages.Close(episode=episode, reason=reason), messages.Closed)

    async def join(
        self,
        episode: str,
        *,
        seat: str | None = None,
        seats: Literal["all"] | Sequence[str] = (),
        role: Literal["player", "spectator"] = "player",
        view: messages.View = "state",
        ready: bool = True,
    ) -> Game:
        """Enter an episode by id or code; returns once its state, or its text, is there.

        Args:
            seat: The player to be; any that is free if None.
            seats: Several players to be, by name, or all whose seats are free now. They are all
                taken, or none.
            view: What the server tells: the `state`, `text` for language models, or `both`.
            ready: Whether the game may begin as soon as all are there; if not, `Game.ready` says
                when. A server of before begins without.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            StrangerError: The episode is said to be on another host.
            ProtocolError: The server refuses: `episode/unknown`, `episode/full`, `seat/taken` and
                others.
            ValueError: An argument is none that the message can have.
        """
        wanted: Any = seats if isinstance(seats, str) else list(seats)
        request = messages.Join(
            episode=episode, seat=seat, seats=wanted, role=role, view=view, ready=ready
        )
        await self._ask(request, messages.Joined)
        if self.game is None:
            raise AssertionError("joined without a game")
        return self.game

    async def rematch(self, *, view: messages.View = "state", ready: bool = True) -> Game:
        """Play the game again that is over: leave it, and enter the one in which all of the team
        meet who ask for this, with the same task, rules and, if they are free, seats.

        Whoever asks first opens it; the others are told its code (`Game.rematch_code`).

        Args:
            view: As in `join`.
            ready: As in `join`.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: `episode/none` where one is in no game; or the server refuses:
                `auth/role` where one may open none and nobody else has asked yet,
                `message/invalid-field` while the game is not over, and those of `create` and
                `join`.
        """
        before = self.game
        if before is None:
            raise ProtocolError(ErrorCode.EPISODE_NONE, "there is no game to play again")
        code = before.rematch_code
        if not code:
            created = await self._ask(messages.Create(rematch=before.episode), messages.Created)
            code = created.code
        await self.leave()
        try:
            return await self.join(code, seats=before.own_seats, view=view, ready=ready)
        except ProtocolError as error:
            if error.code != ErrorCode.SEAT_TAKEN:
                raise
            return await self.join(code, view=view, ready=ready)

    async def rendering(self) -> messages.Rendering:
        """What the task of the episode that one is in looks like; nothing for a shipped one.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: The server refuses, or is of a version without this request.
        """
        return await self._ask(messages.GetRendering(), messages.Rendering)

    async def picture(self, digest: str) -> messages.Picture:
        """A picture of `rendering`.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: The server refuses.
        """
        return await self._ask(messages.GetPicture(digest=digest), messages.Picture)

    async def round_trip(self) -> float:
        """The seconds that a message takes to the server and back, measured now.

        Raises:
            ConnectionFailedError: There is no connection, or it is lost.
        """
        if self._socket is None:
            raise ConnectionFailedError(f"{self.url}: there is no connection")
        try:
            return await (await self._socket.ping())
        except ConnectionClosed:
            raise ConnectionFailedError(f"{self.url}: the connection was lost") from None

    async def leave(self) -> None:
        """Leave the episode; one's seats become free.

        Raises:
            ConnectionFailedError: The connection is over, or 15 seconds of it brought no answer.
            ProtocolError: The server refuses: `episode/none` where one is in no episode.
        """
        await self._ask(messages.Leave(), messages.Left)

    async def _ask(self, request: Request, expected: type[T]) -> T:
        loop = asyncio.get_running_loop()
        ref = self.protocol.request(request, loop.time())
        future = self._answers[ref] = loop.create_future()
        self._flush()
        try:
            answer = await future
        finally:
            del self._answers[ref]
            self.protocol.forget(ref)
        if not isinstance(answer, expected):
            found = type(answer).__name__
            raise ProtocolError(
                ErrorCode.MESSAGE_UNEXPECTED, f"{found} in answer to {request.type}"
            )
        return answer

    # The connection

    async def _run(self) -> None:
        """One connection after the other, until the end."""
        loop = asyncio.get_running_loop()
        try:
            while self.protocol.state is not ClientState.CLOSED:
                if self.protocol.connect_at > loop.time():
                    await asyncio.sleep(self.protocol.connect_at - loop.time())
                try:
                    socket = await self._connect()
                except ConnectionFailedError as error:
                    self.protocol.connection_failed(error, loop.time())
                else:
                    await self._converse(socket)
        finally:
            self.protocol.close("the connection was closed")
            self._flush()

    async def _connect(self) -> ClientConnection:
        server_uri(self.url)
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
            raise ConnectionFailedError(why_not(error, self.url)) from None

    async def _converse(self, socket: ClientConnection) -> None:
        """Take in what comes until the connection ends, or is not wanted any more."""
        loop = asyncio.get_running_loop()
        self._socket = socket
        self.protocol.connection_made(loop.time())
        sender = asyncio.create_task(self._send(socket))
        self._flush()
        reason = ""
        try:
            while self.protocol.state.connected:
                self._receive(self._codec.decode_server(await socket.recv()))
                self._flush()
        except ConnectionClosed as closed:
            reason = str(closed)
        except RobotouilleError as error:
            self.protocol.fail(error)
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sender
            if self.protocol.state.connected:
                self.protocol.connection_lost(loop.time(), reason)
            self._flush()
            await socket.close()

    def _receive(self, message: messages.ServerMessage) -> None:
        self.protocol.receive(message, asyncio.get_running_loop().time())

    async def _send(self, socket: ClientConnection) -> None:
        """Send what there is to send, for as long as there is a connection."""
        with contextlib.suppress(ConnectionClosed):
            while True:
                self._to_send.clear()
                while (message := self.protocol.next_message()) is not None:
                    await socket.send(self._codec.encode(message))
                    self.protocol.message_sent()
                await self._to_send.wait()

    def _flush(self) -> None:
        """Whatever the protocol has decided: tell those who wait, send, and look again in time."""
        if self.protocol.state.online:
            self.connected.set()
        else:
            self.connected.clear()
        for event in self.protocol.events():
            future = self._answers.get(event.ref)
            if future is None or future.done():
                continue
            if isinstance(event, RequestDone):
                future.set_result(event.answer)
            else:
                future.set_exception(event.error)
        for game in (self._game, self.game):
            if game is not None:
                game.wake()
        self._game = self.game
        self._to_send.set()
        self._set_timer()

    def _set_timer(self) -> None:
        due = self.protocol.get_timer()
        if self._timer is not None:
            if self._timer.when() == due:
                return
            self._timer.cancel()
        loop = asyncio.get_running_loop()
        self._timer = None if due is None else loop.call_at(due, self._look_again, due)

    def _look_again(self, due: float) -> None:
        self._timer = None
        self.protocol.handle_timer(max(due, asyncio.get_running_loop().time()))
        if not self.protocol.state.connected and self._socket is not None:
            self._socket.transport.abort()
        self._flush()


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
    """A connection to a server, until the context is left; if it is lost, it is sought again and
    again.

    Args:
        url: `ws://` or `wss://`.
        name: What one wants to be called: 1 to 40 characters.
        reconnect: Without it, a connection that is lost is over.
        token: A signed role token, where the server asks for one.
        resume: The `Client.resume` of a process that stopped: `join` of its episode then gives
            back its seat.
        seed: That of the jitter in the pauses between attempts to connect.

    Raises:
        ConnectionFailedError: The server cannot be reached at first, or does not welcome us within
            15 seconds.
        NotYetError: It asks us to try again in a moment.
        StrangerError: It sends us to another host, or away from TLS.
        ProtocolError: It refuses: `auth/required`, `protocol/version` and others.
        ValueError: The name, the kind or a token cannot be one.
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
