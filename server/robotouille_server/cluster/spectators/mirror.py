"""Mirror of another node's episode, for spectators of this node (docs/decisions/0044).

A mirror stands for the room of an episode that another node has. It receives each update once and
passes it on to all its spectators, as the room does.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, NoReturn, Protocol

from robotouille.episode import Chat, Departure, Phase, Seat
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.cluster.bus import BusError
from robotouille_server.cluster.spectators.mirrored_episode import Updates
from robotouille_server.cluster.spectators.packets import (
    Line,
    Watch,
    Watched,
    subject_of,
)
from robotouille_server.requests import AnswerLater, unheard
from robotouille_server.rooms.membership import too_many_spectators
from robotouille_server.rooms.participants.limited_sight import check_limited_sight
from robotouille_server.rooms.participants.seat_limits import ChatLimits, DisplayNames, FirstNames
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.audience import Audience, SharedMessage
from robotouille_server.rooms.publishing.broadcaster import MAX_SPECTATOR_NAMES, REPEATED_SAID
from robotouille_server.rooms.recording.write_ahead import Readable
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.timer_queue import TimerQueue
from robotouille_server.runtime.weak_calls import weakly

if TYPE_CHECKING:
    from robotouille_server.cluster.node import ClusterNode
    from robotouille_server.requests import Services

ASK_SECONDS, ASK_AT_MOST_SECONDS = 1.0, 0.1
"""Seconds between two requests to the owner: usually, and at least while spectators wait."""
ANSWER_SECONDS = 2.0
IDLE_SECONDS = 2.0
"""Seconds without spectators after which a mirror ends."""
UNKNOWN_SECONDS = 10.0
"""Seconds after which a mirror ends if no node has the episode."""


class MirrorService(Protocol):
    """Service of this node, as its mirrors use it; see `ClusterService`."""

    node: ClusterNode
    services: Services

    async def watch(self, owner: str, request: Watch, seconds: float) -> Watched: ...

    async def say(self, line: Line) -> None: ...


class Mirror:
    """`JoinedRoom` of spectators whose episode is on another node. Use `Mirrors.open`.

    Attributes:
        ready: Is done once spectators may come; its result is False if the owner does not answer.
        seated: The sessions that have seats.
    """

    mirrored = True
    writing = False

    def __init__(self, episode: str, service: MirrorService, timers: TimerQueue) -> None:
        self.id, self.code, self.task = episode, "", ""
        self.grace = 0.0
        self.seated: tuple[str, ...] = ()
        self.closed = False
        self._service = service
        self._node = service.node
        self._sessions = service.services.sessions
        self._loop = asyncio.get_running_loop()
        self.ready: asyncio.Future[bool] = self._loop.create_future()
        self._members: list[Session] = []
        self._banned: tuple[str, ...] = ()
        self._chat_limits = ChatLimits((), self._loop.time())
        budget = service.services.loop_budget
        self._wake = asyncio.Event()
        self._audience = Audience(timers, budget, weakly(self._observed), weakly(self._send_state))
        self._updates = Updates(self._audience.add, weakly(self._caught_up), self._wake.set)
        self._names = DisplayNames(partial(_named_seats, self._updates))
        self._chat, self._first_names = Chat.FREE, FirstNames({})
        self._digest = ""
        self._answered_once = False
        self._unknown_since: float | None = None
        self._idle_since = self._loop.time()
        self.running = self._loop.create_task(self._run())

    # Course

    async def _run(self) -> None:
        """Subscribe to the updates, and ask the owner to publish them, as long as needed."""
        unsubscribe: Callable[[], Awaitable[None]] | None = None
        try:
            with suppress(BusError):
                subject, received = subject_of(self.id), self._updates.receive
                unsubscribe = await self._node.bus.subscribe(subject, received)
            while unsubscribe is not None and not self.closed:
                await self._look()
                await self._pause()
        except Exception:
            get_logger().exception("a mirror failed", episode=self.id)
        finally:
            self.send_away()
            if unsubscribe is not None:
                await unsubscribe()

    async def _pause(self) -> None:
        if not self.closed:
            await asyncio.sleep(ASK_AT_MOST_SECONDS)
            with suppress(TimeoutError):
                async with asyncio.timeout(ASK_SECONDS - ASK_AT_MOST_SECONDS):
                    await self._wake.wait()
            self._wake.clear()

    def look(self) -> None:
        """Ask the owner soon."""
        self._wake.set()

    async def _look(self) -> None:
        record = self._node.directory.find(self.id)
        if record is None:
            self._dismiss("the episode has ended")
        elif record.node == self._node.name or self._node.cut_off or self._idle:
            self.send_away()
        elif self._members and not self.spectators_here:
            # All are away. The owner stops publishing soon, unless other nodes watch.
            self._updates.lose()
        elif (owner := self._node.members.find(record.node)) is not None:
            self._updates.check(record.claim)
            await self._ask(owner.name)

    @property
    def _idle(self) -> bool:
        return not self._members and self._loop.time() - self._idle_since >= IDLE_SECONDS

    async def _ask(self, owner: str) -> None:
        names = [session.name for session in islice(self._present(), MAX_SPECTATOR_NAMES)]
        request = Watch(
            episode=self.id,
            node=self._node.name,
            spectators=self.spectators_here,
            names=tuple(names),
            text=any(session.wants_text for session in self._present()),
            state=self._updates.incomplete or bool(self._audience.waiting),
            task=self._updates.task is None,
            said=self._updates.chat.complete_to,
            first_names=self._first_names.known,
        )
        try:
            watched = await self._service.watch(owner, request, ANSWER_SECONDS)
        except ProtocolError as error:
            if not self.ready.done():
                self.send_away()
            elif error.code == "episode/unknown":
                await self._look_again()
            return
        if not self.closed:
            self._unknown_since = None
            self._answered(watched)

    def _set_ready(self) -> None:
        # Returning spectators need the chat that they have missed, which comes before the snapshot.
        if self._answered_once and not self._updates.lost and not self.ready.done():
            self.ready.set_result(True)

    def _observed(self, event: object) -> SharedMessage | None:
        """Return the spectators' text view after the last step."""
        return self._updates.text

    def _caught_up(self, *, jumped: bool) -> None:
        """Send the snapshot that has arrived to those who need it."""
        self._set_ready()
        # After a gap, even spectators who wait for nothing lack some steps.
        for session in self._members if jumped else list(self._audience.waiting):
            self._audience.ask_snapshot(session)

    async def _look_again(self) -> None:
        """Find the episode, because its owner does not have it any more."""
        now = self._loop.time()
        if self._unknown_since is None:
            self._unknown_since = now
        if self.ended:
            self._dismiss("the episode has ended")
        elif now - self._unknown_since >= UNKNOWN_SECONDS:
            self.send_away()
        else:
            # The copy of the directory may be behind.
            with suppress(BusError):
                await self._node.directory.look(self.code)

    def _answered(self, watched: Watched) -> None:
        self.code, self.task, self.grace = watched.code, watched.task, watched.grace
        self._digest, self.seated = watched.digest, watched.seated
        self._chat = watched.chat
        self._first_names.learn(watched.first_names)
        self._updates.packets.announce(watched.claim, watched.relay, watched.number)
        if not self._answered_once:
            self._answered_once = True
            self._updates.chat.begin_after(watched.said)
        self._set_ready()
        if watched.banned != self._banned:
            self._banned = watched.banned
            for session in list(self._members):
                if self.bans(session.id, session.participant):
                    self._remove(session)
                    self._send_left(session, "removed by the operator")
                    if session.peer is None:
                        self._sessions.sent_out(session)

    def send_away(self) -> None:
        """End, and let all spectators come back, to this node or another one."""
        for session in self._close():
            # The client joins again, as one of a lost node does.
            self._sessions.drop(session)
            peer, session.peer = session.peer, None
            if peer is not None:
                text = "the episode continues on another node"
                peer.close("server/restart", text, retry=True, status=1012)

    def _dismiss(self, reason: str) -> None:
        """End, because the episode is over."""
        for session in self._close():
            self._send_left(session, reason)
            self._sessions.forget(session)

    def _send_left(self, session: Session, reason: str) -> None:
        if session.peer is not None:
            session.peer.send(messages.Left(episode=self.id, reason=reason))

    def _close(self) -> list[Session]:
        """Take no more spectators, and return those that were here."""
        self.closed = True
        self._wake.set()
        if not self.ready.done():
            self.ready.set_result(False)
        members = list(self._members)
        for session in members:
            self._remove(session)
        return members

    # Messages to spectators

    def _send_joined(self, session: Session, ref: int | None) -> None:
        if session.peer is not None:
            joined = messages.Joined(
                ref=ref, episode=self.id, code=self.code, role="spectator", name=session.name,
                step=self.step, said=self._updates.chat.last,
                resume=self._sessions.resume_token(session),
            )  # fmt: skip
            session.peer.send(joined)

    def _send_state(self, session: Session) -> None:
        """Send a snapshot and the roster; wait for them if there is no new snapshot."""
        peer = session.peer
        if peer is None:
            return
        known = session.known
        found = self._updates.catch_up(known, state=session.wants_state, text=session.wants_text)
        if found is None:
            self._audience.wait_for_snapshot(session)
            self._wake.set()
            return
        self._audience.catch_up(session, steps=False)
        if session.wants_state:
            # From now on the client has the task: frames are delivered in order or not at all.
            known.add(self._digest)
        for message in found:
            peer.answer_frame(message.frame(peer.codec))

    # As a room

    @property
    def spectators_here(self) -> int:
        return sum(1 for _ in self._present())

    def _present(self) -> Iterator[Session]:
        return (session for session in self._members if session.peer is not None)

    @property
    def step(self) -> int:
        return self._updates.step

    @property
    def limits_sight(self) -> bool:
        return self._updates.limits_sight

    @property
    def in_progress(self) -> bool:
        return self._updates.phase in (Phase.RUNNING.value, Phase.PAUSED.value)

    def find_star_limits(self) -> None:
        return None

    @property
    def ended(self) -> bool:
        return self._updates.phase == Phase.ENDED.value

    def seat(self, player: str) -> Seat:
        raise KeyError(player)

    def hold(self, connection: Readable) -> None:
        """Do nothing: spectators of other nodes write nothing to a recording."""

    def enter(self, session: Session, request: messages.Join, max_spectators: int) -> None:
        """Let a session watch; send it `joined` and, soon, a snapshot."""
        if self.closed:
            message = "this episode is being handed over; try again in a moment"
            raise ProtocolError("server/handover", message, "episode")
        if self.bans(session.id, session.participant):
            raise ProtocolError("episode/banned", "you were removed from this episode", "episode")
        if self.limits_sight:
            check_limited_sight(session.role, request)
        if self.spectators_here >= max_spectators:
            raise too_many_spectators(max_spectators)
        session.view, session.known = request.view, set(request.known)
        self._add(session)
        self._send_joined(session, request.ref)
        self._send_state(session)
        self._wake.set()

    def _add(self, session: Session) -> None:
        session.players, session.room = (), self
        session.name = self._names.choose(self._first_names.choose(session, self._chat))
        self._names.watch(session.name)
        self._members.append(session)
        self._audience.enter(session)

    def leave(self, session: Session, why: Departure = Departure.LEFT) -> None:
        self._remove(session)

    def _remove(self, session: Session) -> None:
        if session in self._members:
            self._members.remove(session)
            self._audience.leave(session)
            self._names.release(session.name)
            session.room, session.name = None, session.given_name
            self._idle_since = self._loop.time()

    def connection_lost(self, session: Session) -> None:
        session.away_since = self._loop.time()
        away = [one for one in self._members if one.peer is None]
        # As in a room: a client that comes and vanishes in a loop must not fill the memory.
        if len(away) > self._sessions.max_spectators:
            longest = min(away, key=lambda one: one.away_since)
            self._remove(longest)
            self._sessions.forget(longest)

    def readmit(self, session: Session, players: tuple[str, ...]) -> None:
        """Do nothing: spectators of earlier processes join again."""

    def connection_back(self, session: Session, seen: messages.Seen | None) -> None:
        """Send a returning session what it has missed."""
        # This drops what is pending: everything that the client has missed is sent below.
        self._audience.enter(session)
        self._send_joined(session, None)
        chat = self._updates.chat
        if seen is None or seen.episode != self.id:
            # The session may continue in another program, which does not have the task.
            session.known.clear()
            missed = chat.after(0)[-REPEATED_SAID:]
        else:
            session.known.add(self._digest)
            missed = chat.after(seen.said)
        self._send_state(session)
        self._wake.set()
        peer = session.peer
        if peer is None:
            return
        for said in missed:
            peer.send(said)
        for time, notice in self._updates.notices:
            if seen is not None and time >= session.away_since > 0:
                peer.send_frame(notice.frame(peer.codec))

    def check_return(self, session_id: str) -> None:
        """Let spectators come back at any time."""

    def players_of(self, session_id: str) -> tuple[str, ...]:
        return ()

    def bans(self, session_id: str, participant: str) -> bool:
        return session_id in self._banned or participant in self._banned

    def ask_snapshot(self, session: Session) -> None:
        self._audience.ask_snapshot(session)

    # Requests that are for players, or that the owner must answer

    def say(self, session: Session, text: str) -> NoReturn:
        """Forward a chat line to the owner."""
        # The owner has the budget of all nodes together. This one keeps floods off NATS.
        self._chat_limits.charge(session, self._loop.time())
        line = Line(
            episode=self.id,
            session=session.id,
            participant=session.participant,
            name=session.name,
            kind=session.kind,
            text=text,
        )
        session.recorded_bytes += len(text.encode())
        raise AnswerLater(self._service.say(line))

    def set_ready(self, session: Session, ready: bool) -> None:
        session.own_seat(None)

    def signal(self, session: Session, request: messages.Signal) -> None:
        session.own_seat(request.seat)

    def note(self, session: Session, request: messages.Note) -> None:
        session.own_seat(request.seat)

    def act(self, session: Session, request: messages.Act) -> None:
        try:
            session.own_seat(request.seat)
        except ProtocolError as error:
            self.refuse(session, request, error)

    def refuse(self, session: Session, request: messages.Act, why: ProtocolError) -> None:
        self._service.services.metrics.errors.labels(why.code).inc()
        if session.peer is not None:
            self._audience.catch_up(session)
            session.peer.send(unheard(request, session, self.step, why.code, why.message))

    def record_unreadable(self, session: Session, message: bytes | str, why: ProtocolError) -> None:
        """Do nothing: messages of spectators are not recorded."""


def _named_seats(updates: Updates) -> list[tuple[str, str]]:
    return [(seat.player, seat.name) for seat in updates.seats]
