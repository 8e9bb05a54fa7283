"""The asyncio client, which reconnects automatically.

`ClientProtocol` decides what to send and when. This module adds the socket, futures and timers.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

from pydantic import ValidationError
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from robotouille.errors import ProtocolError, RobotouilleError, WrongArgumentError, did_you_mean
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.error_codes import ErrorCode
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.game import Game
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.client_state import ClientState, Request, RequestDone
from robotouille_client.sockets import open_game_socket, ping_often, server_uri

DEFAULT_URL = "ws://127.0.0.1:8765"
MAX_LISTED = 10_000
MAX_LISTED_BYTES = 64 * 2**20
"""Largest number and size of the episodes in a list. A hostile server could send pages for ever."""
MAX_QUOTED = 100
"""Number of characters of an invalid value that an error shows."""

T = TypeVar("T", bound=messages.Message)


def _checked(kind: type[T], **fields: Any) -> T:
    """Return a message.

    Raises:
        WrongArgumentError: There is no such field, or it does not allow the value.
    """
    try:
        return kind(**fields)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    name, options = ".".join(map(str, fault["loc"])), kind.model_fields.keys() - {"type", "ref"}
    if fault["type"] == "extra_forbidden" and name in fields:
        near = did_you_mean(name, options) or "; docs/messages.md lists the options"
        message = f"{kind.model_fields['type'].default} has no option {name!r}{near}"
    else:
        wrong = fault["msg"].removeprefix("Value error, ")
        message = f"{name}: {wrong}, found {repr(fault['input'])[:MAX_QUOTED]}"
    raise WrongArgumentError(message)


class Client:
    """A participant's connection to a server, made by `connect()`.

    Its requests raise `ConnectionFailedError` if the connection is closed, or if the server does
    not answer within 15 seconds of connected time, and `ProtocolError` if the server refuses.

    Args:
        rng: Source of the random delays between connection attempts. Simulations pass a seeded one.

    Attributes:
        connected: Set while there is a connection on which the server has welcomed the client.
    """

    def __init__(
        self,
        url: str,
        *,
        name: str,
        kind: messages.Kind = "bot",
        codec: Codec = MSGPACK,
        reconnect: bool = True,
        token: str | None = None,
        resume: str | None = None,
        rng: random.Random | None = None,
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
            rng=rng,
        )
        self._codec = codec
        self._socket: ClientConnection | None = None
        self._runner: asyncio.Task[None] | None = None
        self._answers: dict[int, asyncio.Future[messages.ServerMessage]] = {}
        self._last_game: Game | None = None
        self._closing: set[asyncio.Task[None]] = set()
        self._to_send = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None

    @property
    def url(self) -> str:
        """The address to connect to. Redirects and lost connections change it."""
        return self.protocol.url

    @url.setter
    def url(self, url: str) -> None:
        self.protocol.url = url

    @property
    def name(self) -> str:
        """The requested name. In an episode it may get a number, see `Game.name`."""
        return self.protocol.name

    @property
    def role(self) -> str:
        """The role that the server granted: operator, host, player or spectator."""
        return self.protocol.role

    @property
    def worker_urls(self) -> list[str]:
        """The addresses of the server's processes; for hosts and operators, if there are several.

        Raises:
            UntrustedRedirectError: An address is on another host, or drops TLS.
        """
        return [self.protocol.addresses.resolve(worker) for worker in self.protocol.workers]

    @property
    def other_urls(self) -> list[str]:
        """The addresses to go to if the connection is lost; empty unless there are several nodes.

        They are those that the user named and those that the server lists.
        """
        return self.protocol.addresses.others

    @property
    def opens_limited_sight(self) -> bool:
        """True if players see a part of the kitchen in episodes that `create` opens by default."""
        return self.protocol.opens_limited_sight

    @property
    def game(self) -> Game | None:
        """The episode that the client is in."""
        return self.protocol.game

    @property
    def farewell(self) -> str:
        """The reason why the client is closed; empty while it is open."""
        return self.protocol.farewell

    @property
    def resume(self) -> str | None:
        """The resume token, which another process can use too. It changes after each use."""
        return self.protocol.resume

    @property
    def resumed(self) -> bool:
        """True if the last connection continued the session of the one before."""
        return self.protocol.resumed

    async def __aenter__(self) -> Self:
        # A misspelled address would otherwise show only when the others fail.
        for named in self.protocol.addresses.named:
            server_uri(named)
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
        """Close the connection. The server keeps the seat for its grace period."""
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
        """Return the episodes on the server that can be joined or watched.

        Args:
            labels: Return only episodes with all of these labels. Hosts see the labels of their
                own episodes.
            closed: Return instead the episodes that were closed because no player joined.

        Once it has `MAX_LISTED` episodes or `MAX_LISTED_BYTES`, the client requests no more.
        """
        found: dict[str, messages.EpisodeInfo] = {}
        size = 0
        request = messages.ListEpisodes(labels=dict(labels or {}), closed=closed)
        while True:
            page = await self._ask(request, messages.Episodes)
            # Episodes that open or close between two pages shift the list, so one may appear twice.
            found.update((one.episode, one) for one in page.episodes)
            skip = request.skip + len(page.episodes)
            size += len(page.model_dump_json())
            complete = not page.episodes or skip >= min(page.total, MAX_LISTED)
            if complete or size >= MAX_LISTED_BYTES:
                return list(found.values())
            request = request.model_copy(update={"skip": skip})

    async def waiting_episode(self, *, partial: bool = False) -> messages.EpisodeInfo | None:
        """Return the first episode that waits for players, if there is one.

        Args:
            partial: True to include episodes whose players see a part of the kitchen, as in `join`.
        """
        waiting = (each for each in await self.episodes() if each.phase == "waiting")
        return next((each for each in waiting if partial or not each.limits_sight), None)

    async def create(self, task: str | None = None, **options: Any) -> messages.Created:
        """Open an episode without joining it. `join` takes the code of the answer.

        Args:
            task: Name of a shipped task, or its unambiguous start; the server's default if None.
            **options: Fields of the `create` message (docs/messages.md).

        Raises:
            ProtocolError: `task/unknown`, `task/invalid`, `server/full` and others.
            WrongArgumentError: There is no such option, or it does not allow the value.
        """
        request = _checked(messages.Create, task=task, **options)
        return await self._ask(request, messages.Created)

    async def close_episode(self, episode: str, reason: str | None = None) -> messages.Closed:
        """Close an episode that this participant has opened, by id or code.

        Operators can close any episode.

        Args:
            reason: Text for its participants.

        Raises:
            ProtocolError: `episode/unknown`, `auth/episode` and others.
            WrongArgumentError: The message does not allow one of the arguments.
        """
        request = _checked(messages.Close, episode=episode, reason=reason)
        return await self._ask(request, messages.Closed)

    async def join(
        self,
        episode: str,
        *,
        seat: str | None = None,
        seats: Literal["all"] | Sequence[str] = (),
        role: Literal["player", "spectator"] = "player",
        view: messages.View = "state",
        ready: bool = True,
        agent: str = "",
        partial: bool = False,
    ) -> Game:
        """Join an episode by code, and return once its state or text has arrived.

        Args:
            seat: The player to control; any free one if None.
            seats: Names of several players to control, or `all` for all free seats. The client
                gets all of them or none.
            view: Data to receive: the `state`, `text` for language models, or `both`.
            ready: False to delay the start until you call `Game.ready`. Servers without this
                feature start anyway.
            agent: Description of the program that plays, with its version and settings, in at most
                200 characters. It is recorded and not shown to others.
            partial: True if the program can play with a part of the state: see `Game.hidden`.

        Raises:
            UntrustedRedirectError: The episode is on another host.
            ProtocolError: `episode/unknown`, `episode/full`, `seat/taken`, `seat/partial` and
                others.
            WrongArgumentError: The message does not allow one of the arguments.
        """
        wanted: Any = seats if isinstance(seats, str) else list(seats)
        request = _checked(
            messages.Join,
            episode=episode,
            seat=seat,
            seats=wanted,
            role=role,
            view=view,
            ready=ready,
            agent=agent,
            partial=partial,
        )
        await self._ask(request, messages.Joined)
        game = self.game
        if game is None:
            raise AssertionError("joined without a game")
        # The resume token has restored the seat before `join`, with its earlier readiness.
        if ready and self.resumed and game.own_seats and game.phase == "waiting":
            game.ready()
        return game

    async def rematch(
        self, *, view: messages.View = "state", ready: bool = True, agent: str = ""
    ) -> Game:
        """Leave the ended game and join its rematch, which has the same task and rules.

        All participants who call this meet in one rematch. The first call opens it, and the
        others learn its code (`Game.rematch_code`). The client gets its former seats if
        they are free.

        Args:
            view: As in `join`.
            ready: As in `join`.
            agent: As in `join`.

        Raises:
            ProtocolError: `episode/none`: the client is in no game; `auth/role`: the client may
                not open episodes, and nobody else has asked for a rematch;
                `message/invalid-field`: the game has not ended; or an error of `create` or `join`.
        """
        before = self.game
        if before is None:
            raise ProtocolError(ErrorCode.EPISODE_NONE, "there is no game to play again")
        code, partial = before.rematch_code, before.hidden is not None
        if not code:
            created = await self._ask(messages.Create(rematch=before.episode), messages.Created)
            code = created.code
        await self.leave()
        try:
            seats = before.own_seats
            return await self.join(
                code, seats=seats, view=view, ready=ready, agent=agent, partial=partial
            )
        except ProtocolError as error:
            if error.code != ErrorCode.SEAT_TAKEN:
                raise
            return await self.join(code, view=view, ready=ready, agent=agent, partial=partial)

    async def rendering(self) -> messages.Rendering:
        """Return the rendering of the episode's task; it is empty for a shipped task.

        Raises:
            ProtocolError: The server refuses, or is too old for this request.
        """
        return await self._ask(messages.GetRendering(), messages.Rendering)

    async def picture(self, digest: str) -> messages.Picture:
        """Return a picture that `rendering` names."""
        return await self._ask(messages.GetPicture(digest=digest), messages.Picture)

    async def round_trip(self) -> float:
        """Measure and return the seconds that a message takes to the server and back.

        Raises:
            ConnectionFailedError: The client has no connection, or loses it.
        """
        if self._socket is None:
            raise ConnectionFailedError(f"{self.url}: there is no connection")
        try:
            return await (await self._socket.ping())
        except ConnectionClosed:
            raise ConnectionFailedError(f"{self.url}: the connection was lost") from None

    async def leave(self) -> None:
        """Leave the episode and free its seats.

        Raises:
            ProtocolError: `episode/none`: the client is in no episode.
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
                ErrorCode.MESSAGE_UNEXPECTED, f"unexpected answer {found} to {request.type}"
            )
        return answer

    # Connection

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            while self.protocol.state is not ClientState.CLOSED:
                if self.protocol.connect_at > loop.time():
                    await asyncio.sleep(self.protocol.connect_at - loop.time())
                try:
                    addresses = self.protocol.addresses
                    socket = await open_game_socket(
                        self.url, self._codec, addresses.connect_seconds, addresses.named
                    )
                except ConnectionFailedError as error:
                    self.protocol.connection_failed(error, loop.time())
                else:
                    await self._converse(socket)
        finally:
            self.protocol.close("the connection was closed")
            self._flush()
            await asyncio.gather(*self._closing)

    async def _converse(self, socket: ClientConnection) -> None:
        loop = asyncio.get_running_loop()
        self._socket = socket
        self.protocol.connection_made(loop.time())
        sender = asyncio.create_task(self._send(socket))
        self._flush()
        reason = ""
        try:
            while self.protocol.state.connected:
                payload = await socket.recv()
                message = self._codec.decode_server(payload)
                self._receive(message, len(payload))
                self._flush()
                if isinstance(message, messages.Welcome) and self.other_urls:
                    ping_often(socket)
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
            self._close(socket)

    def _close(self, socket: ClientConnection) -> None:
        """Close a connection. The next one does not wait for the server's answer to that."""
        closing = asyncio.create_task(socket.close())
        self._closing.add(closing)
        closing.add_done_callback(self._closing.discard)

    def _receive(self, message: messages.ServerMessage, size: int) -> None:
        self.protocol.receive(message, asyncio.get_running_loop().time(), size)

    async def _send(self, socket: ClientConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                self._to_send.clear()
                while (message := self.protocol.next_message()) is not None:
                    await socket.send(self._codec.encode(message))
                    self.protocol.message_sent()
                await self._to_send.wait()

    def _flush(self) -> None:
        # Callers use this after everything that may change the protocol. It resolves futures, wakes
        # the sender and sets the timer.
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
        # A join may have replaced the game: awaiters of the old one learn that it ended.
        for game in (self._last_game, self.game):
            if game is not None:
                game.wake()
        self._last_game = self.game
        self._to_send.set()
        self._set_timer()

    def _set_timer(self) -> None:
        due = self.protocol.get_timer()
        if self._timer is not None:
            if self._timer.when() == due:
                return
            self._timer.cancel()
        loop = asyncio.get_running_loop()
        self._timer = None if due is None else loop.call_at(due, self._on_timer, due)

    def _on_timer(self, due: float) -> None:
        self._timer = None
        self.protocol.handle_timer(max(due, asyncio.get_running_loop().time()))
        # `hello` was not answered in time. A closing handshake would take as long again.
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
) -> AsyncIterator[Client]:
    """Connect to a server, and reconnect whenever the connection is lost, until the context ends.

    Args:
        url: A `ws://` or `wss://` address, or several addresses of one server, separated by
            commas. They are tried in random order.
        name: The requested name, of 1 to 40 characters.
        reconnect: True to reconnect after a lost connection.
        token: A signed role token, if the server requires one.
        resume: Resume token (`Client.resume`) of a process that has stopped. Joining its
            episode then restores its seat.

    Raises:
        ConnectionFailedError: No address is reachable, or no server welcomes the client within
            15 seconds.
        RetryLaterError: The server asks to try again later.
        UntrustedRedirectError: The server redirects to another host or away from TLS.
        ProtocolError: `auth/required`, `protocol/version` and others.
        ValueError: The name, kind or token is invalid.
    """
    codec = MSGPACK if encoding == "msgpack" else JSON
    async with Client(
        url, name=name, kind=kind, codec=codec, reconnect=reconnect, token=token, resume=resume
    ) as client:
        yield client
