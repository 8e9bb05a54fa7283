"""Lobby: opens rooms, finds them by id or code, lists them, and closes them after the end."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from typing import NoReturn

from robotouille.domain.task import Task
from robotouille.episode import Event, Phase
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.join_codes import plain_code
from robotouille_server.auth import in_scope, same_episode
from robotouille_server.rooms.episode_driver import Machinery
from robotouille_server.rooms.episode_setup import EpisodeSetup, task_to_simulate
from robotouille_server.rooms.participants.seat_limits import LOOK_SECONDS
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.participants.sessions import Sessions
from robotouille_server.rooms.recording.archive import ArchivedEpisode
from robotouille_server.rooms.recording.recovery import Recovery
from robotouille_server.rooms.rematches import Asker, FinishedGame, Rematches, check_alone
from robotouille_server.rooms.room import Room, RoomObserver
from robotouille_server.rooms.room_factory import (
    CODE_LENGTH,
    JoinCodes,
    RoomFactory,
    Surroundings,
    UnusedCode,
)
from robotouille_server.rooms.substitutes.substitute import BotScheduler
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import TaskFolder, read_task_folder
from robotouille_server.runtime.timer_queue import Rounds, TimerQueue
from robotouille_server.runtime.workers import is_id
from robotouille_server.transport import LoopBudget

LINGER_SECONDS = 120.0
"""Seconds for which the room of an ended episode is kept, for participants who come back late."""
MAX_LISTED = 500
"""Episodes in one answer to `list`."""
MAX_ENDED = 256
"""Ended episodes whose rooms are kept, apart from those in which participants are connected."""
INSPECTION_SECONDS = 5.0
"""Seconds between two inspections of all open recordings."""
NOBODY = Asker(frozenset())


class Lobby:
    """All rooms of a server.

    Attributes:
        rooms: The rooms by id, those of recently ended episodes included.
        tasks: The operator's own tasks.
        dropped: The number of rooms that no longer exist.
        owned_elsewhere: Returns the number of an owner's episodes on other nodes, reserved or not.
    """

    def __init__(
        self,
        settings: ServerSettings,
        metrics: Metrics,
        sessions: Sessions,
        loop_budget: LoopBudget,
        around: Surroundings,
    ) -> None:
        self.rooms: dict[str, Room] = {}
        self.tasks = read_task_folder(settings.tasks) if settings.tasks else TaskFolder()
        self.dropped = 0
        self.owned_elsewhere: Callable[[str, bool], int] = _none_elsewhere
        self._settings = settings
        self._metrics = metrics
        self._sessions = sessions
        self._worker = around.worker
        # The recordings of a cluster are in NATS.
        self._storage = around.storage if around.cluster is None else None
        self._draining = False
        self._observers: list[RoomObserver] = []
        self._codes = JoinCodes(around.randomness, around.worker)
        self._live: set[Room] = set()
        self._closing: set[asyncio.Future[str]] = set()
        self._lingering: dict[Room, asyncio.TimerHandle] = {}
        self._timers = TimerQueue()
        self._rematches = Rematches(self._timers.time)
        self._bot_scheduler = BotScheduler(around.bot_worker)
        machinery = Machinery(metrics, self._timers, loop_budget, self._bot_scheduler)
        self._factory = RoomFactory(around, self._codes, machinery, sessions, self)
        self._inspection = Rounds(self._live, INSPECTION_SECONDS, _inspect)
        self._round_trips = Rounds(self._live, LOOK_SECONDS, _measure_round_trips)
        self._recovery: Recovery[Room] | None = None
        if around.storage is not None:
            # Without a recordings folder there is nothing to recover, and every resume token for
            # an unknown episode is refused at once.
            now, seconds = self._timers.time, settings.recovery_seconds
            self._recovery = Recovery(
                around.storage, around.worker, seconds, self.adopt, now, around.wall
            )

    @property
    def seats_in_use(self) -> int:
        """Seats in episodes that have not ended."""
        return sum(len(room.world.players) for room in self._live)

    # Observers

    def observe(self, observer: RoomObserver) -> None:
        """Call an observer for all later events, and at once for the rooms that are open now."""
        self._observers.append(observer)
        for room in self.rooms.values():
            if room in self._live:
                observer.opened(room)

    def opened(self, room: Room) -> None:
        for observer in self._observers:
            observer.opened(room)

    def published(self, room: Room, events: list[Event]) -> None:
        for observer in self._observers:
            observer.published(room, events)

    # Opening

    def create(self, request: messages.Create, *, owner: str = "", asker: Asker = NOBODY) -> Room:
        """Open a room.

        Args:
            request: The options of the episode.
            owner: The pseudonym of the participant who opens it.
            asker: The participant who requests a rematch.

        Raises:
            ProtocolError: The options are invalid or the server cannot open another room.
        """
        if request.rematch is not None:
            return self._play_again(request, owner, asker)
        self._check_capacity(owner, reserved=request.open_for is not None)
        setup = EpisodeSetup.requested(request, self._settings, self.tasks)
        return self._add(self._factory.new(setup, owner))

    def task_to_simulate(self, request: messages.Create) -> Task | None:
        """Return the task whose plan `create` would simulate, or None; raise ProtocolError."""
        if request.rematch is not None:
            return None
        return task_to_simulate(request, self._settings, self.tasks)

    def _play_again(self, request: messages.Create, owner: str, asker: Asker) -> Room:
        """Open a rematch, or return the one that another participant has opened already."""
        check_alone(request)
        game = self._finished(request.rematch or "", asker)
        game.check(asker)
        # Players who ask at the same time must meet in one room (docs/decisions/0037).
        existing = self.rooms.get(game.next)
        if existing is not None and existing.episode.phase is not Phase.ENDED:
            return existing
        # The limits apply to new rooms only: players may always join a rematch that another player
        # has opened.
        self._check_capacity(owner, reserved=False)
        self._rematches.charge(game, asker)
        setup = game.setup_for(owner, asker)
        room = self._factory.new(setup, owner, asker.charged_names)
        room.keep_out(game.banned)
        self._add(room)
        self._rematches.opened(game, room, asker)
        if (before := self.rooms.get(game.episode)) is not None:
            before.offer_rematch(room.code)
        return room

    def _finished(self, name: str, asker: Asker) -> FinishedGame:
        game = self._rematches.find(name)
        if game is None:
            self._refuse_rematch(name, asker)
        return game

    def _refuse_rematch(self, name: str, asker: Asker) -> NoReturn:
        """Raise the error for an episode that runs, is on another worker, or is unknown."""
        room = self._known(name) or self._found_elsewhere(name)
        # Other participants must not find out which codes exist.
        if room is not None and not room.membership.ever_seated.isdisjoint(asker.names):
            message = "this game has not ended yet; request a rematch after its end"
            raise ProtocolError("message/invalid-field", message, "rematch")
        message = "no recent episode has this id or code; create a new one"
        raise ProtocolError(ErrorCode.EPISODE_UNKNOWN, message, "rematch")

    def _check_capacity(self, owner: str, *, reserved: bool) -> None:
        if self.draining:
            message = "this server is about to be restarted; try again in a moment"
            raise ProtocolError("server/draining", message)
        if len(self._live) >= self._settings.max_episodes:
            message = f"{len(self._live)} episodes are running already; try again later"
            raise ProtocolError("server/full", message)
        self._check_space()
        # Sessions without a token have no pseudonym to count by, so only the total limit applies to
        # them.
        if not owner:
            return
        alike = (room.owner == owner and room.reserved == reserved for room in self._live)
        own, settings = sum(alike) + self.owned_elsewhere(owner, reserved), self._settings
        if reserved and own >= settings.max_reserved_per_owner:
            message = f"{own} of your episodes wait for their first player; close one of them first"
            raise ProtocolError("rate/episodes", message)
        if not reserved and own >= settings.max_episodes_per_owner:
            message = f"{own} of your episodes are running already; end one of them first"
            raise ProtocolError("rate/episodes", message)

    def _check_space(self) -> None:
        """Leave the last space on the disk to the episodes that run already."""
        least = self._settings.reserved_bytes
        if self._storage is None or not least:
            return
        try:
            free = self._storage.free_space()
        except OSError:  # The error of creating the recording says more.
            return
        if free < least:
            message = "the disk for recordings is nearly full; ask the server's operator for space"
            raise ProtocolError("server/full", message)

    def _add(self, room: Room) -> Room:
        self.rooms[room.id] = room
        self._codes.add(room)
        # Rooms that only show the end of an archived episode do not count towards the limits.
        if room.episode.phase is not Phase.ENDED:
            self._live.add(room)
            if room.journal is not None:
                self._inspection.begin()
                self._round_trips.begin()
            self.opened(room)
        self._count()
        # `flush` publishes the events of the restart or the opening, and sets the first timer.
        room.driver.flush()
        return room

    # Restarts

    def recover(self) -> None:
        """Continue the episodes that another process has left."""
        if self._recovery is not None:
            self._recovery.scan(self.rooms)

    def start_patience(self) -> None:
        """Start the time that restored episodes wait for their players.

        The server calls this once clients can reach it. Until then, no player can return.
        """
        now = self._timers.time()
        for room in self.rooms.values():
            room.episode.renew_patience(now, self._settings.recovery_seconds)
            room.driver.flush()

    @property
    def draining(self) -> bool:
        """True if this process leaves its episodes to the next one."""
        return self._draining

    def drain(self) -> None:
        """Open no more episodes and restore none."""
        self._draining = True
        if self._recovery is not None:
            self._recovery.stop()

    @property
    def unrestored(self) -> dict[str, str]:
        """Recordings that could not be continued (yet), with the reasons."""
        return {} if self._recovery is None else self._recovery.unrestored

    def adopt(self, found: ArchivedEpisode) -> Room:
        """Make a room for an episode that began in another process."""
        room = self._factory.restored(found)
        if found.journal is not None and (by := found.head.get("rematch_by")):
            self._rematches.continued(room, by)
        self._add(room)
        if found.journal is None:
            # The episode has ended in an earlier process; the room only shows its end.
            room.suspend()
            self._linger(room, archived=True)
            return room
        self._metrics.restored.inc()
        step = room.episode.step
        get_logger().info("episode restored", episode=room.id, code=room.code, step=step)
        return room

    def now(self) -> float:
        """Return the time of the rooms."""
        return self._timers.time()

    # Finding

    def find(self, name: str) -> Room:
        """Return the room with an id or code, for hosts, operators and resumed sessions.

        Raises:
            ProtocolError: `episode/unknown` for any other name.
        """
        room = self._known(name) or self._found_elsewhere(name)
        if room is None:
            self._codes.check_unused(name)
            raise _unknown(name)
        return room

    def find_by_code(self, name: str, only: str) -> Room:
        """Return the room with a code, or with the id of the episode of a token.

        Ids are not secret: they are in file names, exports and MQTT topics. Participants therefore
        get the same error for an id as for a wrong code.

        Args:
            name: The code or id.
            only: The id or code of the episode of the participant's token, or empty.

        Raises:
            ProtocolError: `episode/unknown` for any other name.
        """
        room = self.rooms.get(name)
        # This worker does not know the codes of episodes on other workers, so a token for such a
        # code does not admit the episode's id.
        own = (name,) if room is None else (room.id, room.code)
        if is_id(name) and not (only and any(same_episode(only, one) for one in own)):
            raise _unknown(name)
        return self.find(name)

    def home_of(self, session: str, episode: str) -> Room | None:
        """Return the room of a resume token.

        This is the room in which the session held seats before a restart, or otherwise the room
        that the token names. The seats come first, because a session may have taken them after its
        token was made.
        """
        if self._recovery is not None:
            seated = self._recovery.seated(session)
            if seated is not None:
                return seated
        if not episode:
            return None
        return self.rooms.get(episode) or self._found_elsewhere(episode)

    def may_have_ended(self, episode: str) -> bool:
        """Return whether an episode without a room may be in the archive; see `show_end`."""
        return self._recovery is not None and self._recovery.archive.may_have(episode)

    async def show_end(self, episode: str) -> None:
        """Make a room with the final state of an archived episode, if there is one.

        Raises:
            ProtocolError: The search in the archive would take too long.
        """
        if self._recovery is not None and episode not in self.rooms:
            await self._recovery.archive.show(episode)

    def _known(self, name: str) -> Room | None:
        return self.rooms.get(name) or self._codes.find(name)

    def _found_elsewhere(self, name: str) -> Room | None:
        """Return a room that was just handed over; raise if another process has it."""
        # This raises `ElsewhereError` with the address of the worker that has the episode
        # (docs/decisions/0017).
        self._worker.check_here(name, plain_code(name), CODE_LENGTH)
        if self.draining or (self._recovery is not None and self._recovery.elsewhere(name)):
            message = "this episode is being handed over; try again in a moment"
            raise ProtocolError("server/handover", message, "episode")
        return self._known(name)

    def infos(
        self, request: messages.ListEpisodes, only: str, owner: str, *, operator: bool
    ) -> messages.Episodes:
        """List rooms, those that wait for players first.

        Args:
            request: The filter and the page.
            only: The id or code of a single episode to list, or empty for all.
            owner: The pseudonym of the participant who asks. Labels are shown to an episode's
                owner only.
            operator: True if the participant is an operator, who sees all labels.
        """
        wanted = request.labels.items()
        if request.closed:
            closed = [
                one.info
                for one in self._codes.unused()
                if (operator or one.owner == owner)
                and in_scope(only, one.info.episode, one.info.code)
                and wanted <= one.info.labels.items()
            ]
            page = closed[request.skip : request.skip + MAX_LISTED]
            return messages.Episodes(ref=request.ref, episodes=page, total=len(closed))
        rooms = [self._known(only.strip())] if only else self._in_order()
        found = [
            (room, labels)
            for room in rooms
            if room is not None
            and wanted <= (labels := labels_for(room, owner, operator=operator)).items()
        ]
        shown = found[request.skip : request.skip + MAX_LISTED]
        return messages.Episodes(
            ref=request.ref, episodes=[info(*each) for each in shown], total=len(found)
        )

    def _in_order(self) -> list[Room]:
        order = {Phase.WAITING: 0, Phase.RUNNING: 1, Phase.PAUSED: 1, Phase.ENDED: 2}
        return sorted(self.rooms.values(), key=lambda room: order[room.episode.phase])

    # Closing

    def close(self, name: str, reason: str, owner: str, *, operator: bool) -> Room:
        """End an episode.

        Raises:
            ProtocolError: `episode/unknown`, or `auth/episode` if it is another owner's.
        """
        room = self.find(name)
        if not operator and room.owner != owner:
            message = "only the host who opened this episode or an operator can close it"
            raise ProtocolError("auth/episode", message, "episode")
        room.abort(reason)
        return room

    def ended(self, room: Room) -> None:
        """Finish the recording of an ended episode, and keep its room for a while."""
        self._live.discard(room)
        self._count()
        if room.reserved:
            self._codes.close_unused(UnusedCode(info(room, room.labels), room.owner))
            get_logger().info("episode closed unused", episode=room.id, code=room.code)
        if room.journal is not None:
            # A researcher expects a file for every labelled or reserved episode, played or not.
            # Other unplayed episodes would only fill the folder with empty recordings.
            kept = room.episode.record.used or room.reserved or bool(room.labels)
            closing = room.journal.finish(kept=kept)
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)
            closing.add_done_callback(partial(_name_recording, room))
        self._linger(room)

    def _linger(self, room: Room, *, archived: bool = False) -> None:
        self._rematches.add(room, archived=archived)
        # Keep the room at least for the grace period: an absent participant may return for as long
        # after the end as during the episode.
        seconds = max(LINGER_SECONDS, room.episode.rules.grace)
        # Nobody returns to an episode that nobody has joined. If it stayed, the kitchen of a shift
        # with a seed of its own would survive the cheap garbage collections.
        if not (archived or room.episode.record.used or room.members):
            seconds = 0.0
        loop = asyncio.get_running_loop()
        self._lingering[room] = loop.call_later(seconds, self._forget, room)
        self._limit_ended(room)

    def _limit_ended(self, newest: Room) -> None:
        """Close the oldest ended room in which nobody is connected, if there are too many rooms.

        Rooms with connected participants need no limit: there are fewer of them than connections.
        """
        if len(self._lingering) > MAX_ENDED:
            deserted = (r for r in self._lingering if r is not newest and not r.occupied)
            if (oldest := next(deserted, None)) is not None:
                self._forget(oldest)

    async def closed(self) -> None:
        """Wait until all ended recordings are closed and the substitutes' worker has ended."""
        await self._bot_scheduler.close()
        if self._closing:
            await asyncio.wait(self._closing)

    def suspend(self, episode: str) -> list[Session]:
        """Hand an episode over to another process. Return its members the first time."""
        room = self.rooms.get(episode)
        if room is None:
            return []
        room.suspend()
        self._drop(room)
        return list(room.members)

    def give_up(self, episode: str) -> list[Session]:
        """Drop an episode that another node has; return the sessions that were in it."""
        room = self.rooms.get(episode)
        if room is None:
            return []
        members = list(room.members)
        room.suspend()
        self._drop(room)
        for session in members:
            session.room, session.players = None, ()
            # The other node has the session now. If it comes back here, it comes with its seats.
            self._sessions.drop(session)
        room.let_go()
        return members

    async def stop(self) -> None:
        """Cancel all timers and searches."""
        self._timers.clear()
        self._inspection.stop()
        self._round_trips.stop()
        for timer in self._lingering.values():
            timer.cancel()
        self._lingering.clear()
        if self._recovery is not None:
            await self._recovery.close()

    def _forget(self, room: Room) -> None:
        self._lingering.pop(room).cancel()
        self._drop(room)
        for session in list(room.members):
            if session.peer is None:
                self._sessions.forget(session)
        room.membership.dismiss(room.id)

    def _drop(self, room: Room) -> None:
        self.rooms.pop(room.id, None)
        self.dropped += 1
        self._live.discard(room)
        self._rematches.drop(room)
        self._codes.drop(room)
        if self._recovery is not None:
            self._recovery.forget(room)
        self._count()

    def _count(self) -> None:
        self._metrics.episodes.set(len(self._live))


def _none_elsewhere(owner: str, reserved: bool) -> int:
    return 0


def _unknown(name: str) -> ProtocolError:
    message = f"no episode has the id or code {name!r}, or it has ended"
    return ProtocolError("episode/unknown", message, "episode")


def labels_for(room: Room, owner: str, *, operator: bool) -> Mapping[str, str]:
    """Return the labels that a participant with the pseudonym `owner` may see.

    Other participants must not see them: a label may name their experimental condition.
    """
    return room.labels if operator or room.owner == owner else {}


def info(room: Room, labels: Mapping[str, str]) -> messages.EpisodeInfo:
    """Return the description of a room in a list."""
    episode = room.episode
    rules, outcome = episode.rules, episode.outcome
    return messages.EpisodeInfo(
        episode=room.id,
        code=room.code,
        task=room.world.task.name,
        clock=rules.clock.value,
        phase=room.episode.phase,
        step=episode.step,
        max_steps=rules.max_steps,
        seats=room.broadcaster.seats(),
        spectators=room.spectators,
        sight=rules.sight,
        sight_blocked=rules.sight_blocked,
        labels=dict(labels),
        created=room.created if labels or room.reserved else "",
        closes=room.closes_in if outcome is None else None,
        reason=outcome.reason.value if outcome else "",
        detail=outcome.detail if outcome else "",
    )


def _inspect(room: Room) -> bool:
    return room.journal is not None and room.journal.repair_if_changed()


def _measure_round_trips(room: Room) -> bool:
    return room.driver.measure_round_trips()


def _name_recording(room: Room, closing: asyncio.Future[str]) -> None:
    if not closing.cancelled() and closing.exception() is None:
        room.recording = closing.result()
