"""Rooms: one episode on a server, with its participants, its clock and its recording."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Protocol

from robotouille.certification.stars import StarLimits, star_limits
from robotouille.episode import Departure, Event, Moderation, PauseReason
from robotouille.episode.quota import NOTE_BYTES
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.world.presentation.signals import Signal
from robotouille_server.rooms.action_requests import ActionRequests
from robotouille_server.rooms.episode_driver import EpisodeDriver, EpisodeParts, Machinery
from robotouille_server.rooms.membership import Membership
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.rooms.publishing.publisher import SpectatorRosters
from robotouille_server.rooms.recording.write_ahead import CommitGate, Readable
from robotouille_server.runtime.weak_calls import weakly

if TYPE_CHECKING:
    from robotouille.episode import Episode, Seat
    from robotouille.protocol.states import StateWriter
    from robotouille_server.rooms.participants.sessions import Sessions
    from robotouille_server.rooms.recording.journal import EpisodeJournal


MAX_GUESTS = 64


class RoomObserver(Protocol):
    """Observer that is called during a room's step.

    Implementations must return quickly and must not raise.
    """

    def opened(self, room: Room) -> None:
        """React to a room that was opened, or restored after a restart."""

    def published(self, room: Room, events: list[Event]) -> None:
        """React to events that were written and published."""


class RoomKeeper(RoomObserver, Protocol):
    """Lobby, as its rooms see it."""

    def ended(self, room: Room) -> None:
        """React to the end of a room's episode."""


@dataclass(frozen=True, slots=True)
class RoomFacts:
    """Facts about a room that never change.

    Attributes:
        id: The id of the episode.
        code: The code with which participants join.
        owner: The pseudonym of the participant who opened the episode, or empty.
        labels: The labels that a study attached to the episode.
        created: The time at which the episode was opened.
        seed: The seed with which the task was loaded.
    """

    id: str
    code: str
    owner: str
    labels: Mapping[str, str]
    created: str
    seed: int


class Room:
    """One episode with its participants.

    It passes requests of participants and operators to its parts: `membership` knows who is in the
    room, `driver` applies changes to the episode and publishes them.

    Attributes:
        recording: The file name of the finished recording, or empty.
        guests: The spectators on other nodes who have written last, for operators.
    """

    __slots__ = (
        "__weakref__",
        "_actions",
        "_gate",
        "_keeper",
        "broadcaster",
        "code",
        "created",
        "driver",
        "episode",
        "guests",
        "id",
        "journal",
        "labels",
        "membership",
        "owner",
        "recording",
        "seed",
        "world",
    )

    def __init__(
        self,
        facts: RoomFacts,
        episode: Episode,
        writer: StateWriter,
        journal: EpisodeJournal | None,
        machinery: Machinery,
        sessions: Sessions,
        keeper: RoomKeeper,
    ) -> None:
        self.id, self.code, self.owner = facts.id, facts.code, facts.owner
        self.labels, self.created, self.seed = facts.labels, facts.created, facts.seed
        self.episode = episode
        self.world = episode.world
        self.journal = journal
        self.recording = ""
        self.guests: dict[str, Session] = {}
        self._keeper = keeper
        now = machinery.timers.time
        self._gate = CommitGate(journal)
        self.broadcaster = Broadcaster(
            self.id,
            self.code,
            episode,
            writer,
            machinery.timers,
            machinery.loop_budget,
            self._gate,
        )
        rosters = SpectatorRosters(machinery.timers, self._gate, self.broadcaster.publish_roster)
        self.membership = Membership(
            episode, self.broadcaster, self._gate, rosters, sessions, self.labels, now()
        )
        parts = EpisodeParts(episode, journal, self._gate, self.broadcaster, self.membership)
        self.driver = EpisodeDriver(
            self.id, parts, machinery, published=weakly(self._published), ended=weakly(self._ended)
        )
        self._actions = ActionRequests(episode, self.broadcaster, self._gate, machinery.metrics)

    def _published(self, events: list[Event]) -> None:
        self._keeper.published(self, events)

    def _ended(self) -> None:
        self._keeper.ended(self)

    @property
    def members(self) -> list[Session]:
        """Sessions that play or watch."""
        return self.broadcaster.members

    @property
    def spectators(self) -> int:
        """Number of spectators, those on other nodes included."""
        return self.broadcaster.spectators

    @property
    def spectators_here(self) -> int:
        return self.broadcaster.spectators_here

    @property
    def occupied(self) -> bool:
        """True if a participant is connected, here or on another node."""
        here = any(session.peer is not None for session in self.members)
        return here or self.broadcaster.mirrored[0] > 0

    @property
    def mirrored(self) -> bool:
        return False

    @property
    def task(self) -> str:
        return self.world.task.name

    def find_star_limits(self) -> StarLimits | None:
        # The plan is simulated once for each task, for step limits, too.
        rules, task = self.episode.rules, self.world.task
        # The length of a plan depends on where hidden things are.
        if task.problem.shift is not None or rules.limited_sight is not None:
            return None
        return star_limits(task, rules.step_rate if rules.scheduled else None)

    @property
    def step(self) -> int:
        return self.episode.step

    @property
    def limits_sight(self) -> bool:
        return self.episode.record.sight is not None

    @property
    def in_progress(self) -> bool:
        return self.episode.in_progress

    @property
    def ended(self) -> bool:
        return self.episode.ended

    @property
    def grace(self) -> float:
        return self.episode.rules.grace

    def seat(self, player: str) -> Seat:
        return self.episode.seat(player)

    @property
    def problem(self) -> str:
        """Problem with the recording, for the operator, or empty."""
        return self.journal.problem if self.journal is not None else ""

    @property
    def writing(self) -> bool:
        """True while a replicated recording is being written; see `CommitGate.hold`."""
        return self._gate.writing

    def hold(self, connection: Readable) -> None:
        """Read no more from a connection until the recording is written."""
        self._gate.hold(connection)

    def let_go(self) -> None:
        """Read from all connections again, because another process writes the recording."""
        self._gate.let_go()

    @property
    def reserved(self) -> bool:
        """True if the room is kept open and waits for its first participant."""
        return self.episode.rules.open_for is not None and not self.episode.record.used

    @property
    def closes_in(self) -> float | None:
        """Seconds until a reserved room is closed."""
        until = self.episode.pauses.until.get(PauseReason.DESERTED) if self.reserved else None
        return None if until is None else round(max(0.0, until - self.driver.now()), 3)

    # Requests of participants

    def enter(self, session: Session, request: messages.Join, max_spectators: int) -> None:
        """Take seats or watch; send the session `joined` and a snapshot."""
        # The events of the join are published before the newcomer becomes a member, because its
        # first message must be `joined`.
        self.driver.apply(self.membership.join, self, session, request, max_spectators)
        # `welcome` comes after `apply`, which has published the join: the newcomer must not receive
        # it.
        self.membership.welcome(session, request.ref)

    def set_ready(self, session: Session, ready: bool) -> None:
        self.driver.apply(self.membership.set_ready, session, ready)

    def leave(self, session: Session, why: Departure = Departure.LEFT) -> None:
        self.driver.apply(self.membership.leave, session, why=why)

    def act(self, session: Session, request: messages.Act) -> None:
        """Submit the action of a seat; an invalid request is answered by `rejected`."""
        self.driver.apply(self._actions.submit, session, request)

    def refuse(self, session: Session, request: messages.Act, why: ProtocolError) -> None:
        """Reject an action that is not evaluated, and record that."""
        self.driver.apply(self._actions.refuse, session, request, why)

    def record_unreadable(self, session: Session, message: bytes | str, why: ProtocolError) -> None:
        """Record an unreadable message of a player. The caller answers it."""
        self.driver.apply(self._actions.record_unreadable, session, message, why)

    def say(self, session: Session, text: str) -> None:
        """Post a chat message."""
        # Chat is refused while writing fails, because unwritten messages would accumulate: a disk
        # may be full for hours.
        self._gate.check()
        self.membership.check_chat(session, self.driver.now())
        self.driver.apply(self.episode.say, session.name, session.player or "", text)
        session.recorded_bytes += len(text.encode())

    def signal(self, session: Session, request: messages.Signal) -> None:
        """Post a signal of a seat."""
        self._gate.check()
        player = session.own_seat(request.seat)
        self.membership.check_chat(session, self.driver.now())
        signal = Signal(request.intent, request.target or "")
        self.driver.apply(self.episode.signal, session.name, player, signal)
        session.recorded_bytes += NOTE_BYTES

    def note(self, session: Session, request: messages.Note) -> None:
        """Record a note of a player; bots may receive one for their team."""
        self._gate.check()
        player, text = session.own_seat(request.seat), request.text
        self.driver.apply(self.episode.note, player, request.topic, text, more=request.more)
        session.recorded_bytes += len(text.encode())

    def ask_snapshot(self, session: Session) -> None:
        """Send a snapshot; several requests may share one."""
        self.broadcaster.ask_snapshot(session)

    # Connections

    def connection_lost(self, session: Session) -> None:
        self.driver.apply(self.membership.connection_lost, session)

    def check_return(self, session_id: str) -> None:
        """Raise ProtocolError if a session may not come back now; see `Membership`."""
        self.membership.check_return(session_id, self.driver.now())

    def connection_back(self, session: Session, seen: messages.Seen | None) -> None:
        """Mark a returning session as present, and send it what it has missed."""
        # Its first message must be `joined`. The roster about its return is part of what follows.
        peer, session.peer = session.peer, None
        try:
            self.driver.apply(
                self.episode.set_present, session.players, True, generation=session.generation
            )
        finally:
            session.peer = peer
        self.membership.welcome_back(session, seen)

    def readmit(self, session: Session, players: tuple[str, ...]) -> None:
        """Give a session of an earlier process its seats and name back."""
        self.membership.readmit(self, session, players)

    def players_of(self, session_id: str) -> tuple[str, ...]:
        return self.membership.players_of(session_id)

    def bans(self, session_id: str, participant: str) -> bool:
        return self.membership.bans(session_id, participant)

    # Spectators on other nodes

    def begin_relay(self, relay: Session) -> None:
        """Send everything that spectators receive to a session for other nodes, too."""
        self.broadcaster.begin_relay(relay)

    def end_relay(self, relay: Session) -> None:
        self.broadcaster.leave(relay)
        self.membership.forget(relay)

    def send_to_relay(self, relay: Session, said: int) -> None:
        """Send a relay what new spectators need, once everything is recorded."""
        send: Callable[[], object] = partial(self.broadcaster.send_to_relay, relay, said)
        if self._gate.writing:
            # Deferred answers are sent before the events that they wait for. A relay needs these
            # events first, because other spectators need the last step before its snapshot.
            loop = asyncio.get_running_loop()
            send = partial(loop.call_soon, self.send_to_relay, relay, said)
        self._gate.when_committed(relay, send)

    def mirrored_by(self, spectators: int, names: Sequence[str]) -> None:
        """Note the spectators on other nodes."""
        if self.broadcaster.mirrored != (spectators, tuple(names)):
            self.broadcaster.mirrored = spectators, tuple(names)
            self.membership.spectators_changed()

    def say_for(self, guest: Session, text: str) -> None:
        """Post a chat message of a spectator on another node."""
        guest = self.guests.pop(guest.id, guest)
        self.guests[guest.id] = guest
        if len(self.guests) > MAX_GUESTS:
            del self.guests[next(iter(self.guests))]
        self.say(guest, text)

    # Requests of operators

    def kick(self, session: Session, reason: str) -> None:
        """Remove a participant with all its sessions, and refuse to let it in again."""
        self.driver.apply(self.membership.moderate, Moderation.BANNED, session)
        # One participant may have several sessions, for example a second one that watches.
        for member in list(self.members):
            if self.bans(member.id, member.participant):
                self.leave(member, Departure.REMOVED)
                self.membership.send_out(member, self.id, reason)

    def keep_out(self, banned: Iterable[str]) -> None:
        """Refuse sessions and participants who were removed from an earlier game.

        The next `flush` of the driver records this.
        """
        for one in sorted(banned):
            self.episode.moderate(Moderation.BANNED, one, "", "", self.driver.now())

    def mute(self, session: Session) -> None:
        """Forbid a participant to chat in this episode until `unmute`."""
        # A repeated request must not add another event to the recording.
        if not self.mutes(session):
            self.driver.apply(self.membership.moderate, Moderation.MUTED, session)

    def unmute(self, session: Session) -> None:
        """Let a participant chat again."""
        if self.mutes(session):
            self.driver.apply(self.membership.moderate, Moderation.UNMUTED, session)

    def mutes(self, session: Session) -> bool:
        return self.membership.mutes(session)

    def pause(self) -> None:
        """Pause the episode until `resume`."""
        self.driver.apply(self.episode.pause, PauseReason.OPERATOR)

    def resume(self) -> None:
        self.driver.apply(self.episode.resume, PauseReason.OPERATOR)

    def announce(self, text: str) -> None:
        """Send an announcement to everybody in the episode."""
        self.driver.apply(self.episode.announce, text)

    def abort(self, reason: str) -> None:
        """End the episode."""
        self.driver.abort(reason)

    # The end

    def offer_rematch(self, code: str) -> None:
        """Tell everybody in an ended room the code of the next game."""
        self.broadcaster.rematch = code
        self.broadcaster.publish_roster()

    def suspend(self) -> None:
        """Stop without ending the episode, so that another process can continue it."""
        self.driver.suspend()
