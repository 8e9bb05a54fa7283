"""The lobby: open rooms, find them by id or code, close them when they are over."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, NoReturn

from robotouille.episode import Episode, Phase, Rules
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.replay.recorder import Recorder, header
from robotouille.world.world import shared_world
from robotouille_server.rooms.broadcast.broadcaster import Broadcaster
from robotouille_server.rooms.directory.episode_setup import EpisodeSetup
from robotouille_server.rooms.directory.listing import (
    MAX_LISTED,
    UnusedCode,
    UnusedCodes,
    info,
    labels_for,
)
from robotouille_server.rooms.directory.rematches import FinishedGame, Rematches, check_alone
from robotouille_server.rooms.recordings import (
    ArchivedEpisode,
    Journal,
    Recovery,
    Storage,
    file_name,
)
from robotouille_server.rooms.room import Room, RoomHost, RoomObserver
from robotouille_server.rooms.seats.round_trips import LOOK_SECONDS
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.substitutes.bot_scheduler import BotScheduler
from robotouille_server.rooms.substitutes.bot_worker import BotWorker
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.rounds import Rounds
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import TaskFolder, read_task_folder
from robotouille_server.runtime.timer_queue import TimerQueue
from robotouille_server.runtime.workers import CODE_LETTERS, WorkerSlot, plain_code

__all__ = ["CODE_LENGTH", "Lobby"]

CODE_LENGTH = 10
LINGER_SECONDS = 120.0

INSPECTION_SECONDS = 5.0
"""From the end of one look at all open recordings to the next one."""


class Lobby:
    """All rooms of a server. `random` names them; `timestamp` says when, for recordings, and
    `wall` in seconds since 1970."""

    def __init__(
        self,
        settings: ServerSettings,
        metrics: Metrics,
        randomness: random.Random,
        timestamp: Callable[[], str],
        wall: Callable[[], float],
        *,
        storage: Storage | None,
        worker: WorkerSlot,
        resume_token: Callable[[Session], str],
        vacated: Callable[[Session], None],
        sent_out: Callable[[Session], None],
        bot_worker: Callable[[], BotWorker],
    ) -> None:
        self.rooms: dict[str, Room] = {}
        self._draining = False
        self._codes: dict[str, Room] = {}
        self._settings = settings
        self._metrics = metrics
        self._random = randomness
        self._timestamp = timestamp
        self._wall = wall
        self._unused = UnusedCodes()
        self._rematches = Rematches()
        self.tasks = read_task_folder(settings.tasks) if settings.tasks else TaskFolder()
        self._storage = storage
        self._worker = worker
        self.dropped = 0
        self._live: set[Room] = set()
        self._closing: set[asyncio.Future[str]] = set()
        self._lingering: dict[Room, asyncio.TimerHandle] = {}
        self._bot_scheduler = BotScheduler(bot_worker)
        self._host = RoomHost(
            metrics,
            resume_token,
            vacated,
            sent_out,
            self._closed,
            TimerQueue(),
            self._bot_scheduler,
        )
        self._inspection = Rounds(self._live, INSPECTION_SECONDS, _inspect)
        self._round_trips = Rounds(self._live, LOOK_SECONDS, Room.look_at_round_trips)
        self._recovery: Recovery[Room] | None = None
        if storage is not None:
            now, seconds = self._host.timers.time, settings.recovery_seconds
            self._recovery = Recovery(storage, worker, seconds, self._adopt, now, wall)

    def observe(self, observer: RoomObserver) -> None:
        """From here on somebody is told of all rooms; of those that there are, at once."""
        self._host.observer = observer
        for room in self.rooms.values():
            if room in self._live:
                observer.opened(room)

    # Opening

    def create(
        self, request: messages.Create, *, owner: str = "", asker: Collection[str] = ()
    ) -> Room:
        """Open a room; ProtocolError names what cannot be had.

        Args:
            owner: The pseudonym of who opens it.
            asker: The session and the pseudonym of who asks, for the same game again.
        """
        if request.rematch is not None:
            return self._play_again(request, owner, asker)
        self._check_capacity(owner, reserved=request.open_for is not None)
        return self._open(EpisodeSetup.requested(request, self._settings, self.tasks), owner)

    def _play_again(self, request: messages.Create, owner: str, asker: Collection[str]) -> Room:
        """The same game as one that is over; all who ask for that get the same room."""
        check_alone(request)
        game = self._finished(request.rematch or "")
        game.check(asker)
        opened = self.rooms.get(game.again)
        if opened is not None and opened.episode.phase is not Phase.ENDED:
            return opened
        self._check_capacity(owner, reserved=False)
        room = self._open(game.setup_for(owner), owner)
        game.again = room.id
        if (before := self.rooms.get(game.episode)) is not None:
            before.play_again(room.code)
        return room

    def _finished(self, name: str) -> FinishedGame:
        """A game that is over; ProtocolError if there is none, or it is not."""
        game = self._rematches.find(name)
        if game is None:
            self._refuse_rematch(name)
        return game

    def _refuse_rematch(self, name: str) -> NoReturn:
        """Of a game that is not over, is elsewhere, or of which nobody here knows any more."""
        try:
            self.find(name)
        except ProtocolError as error:
            if error.code != ErrorCode.EPISODE_UNKNOWN:
                raise
            message = "no episode has this id or code, or it was too long ago: open a new one"
            raise ProtocolError(ErrorCode.EPISODE_UNKNOWN, message, "rematch") from None
        message = "this game is not over; it can be played again when it is"
        raise ProtocolError("message/invalid-field", message, "rematch")

    def _check_capacity(self, owner: str, *, reserved: bool) -> None:
        if self.draining:
            message = "this server is about to be restarted; try again in a moment"
            raise ProtocolError("server/draining", message)
        if len(self._live) >= self._settings.max_episodes:
            message = f"{len(self._live)} episodes run already; try again later"
            raise ProtocolError("server/full", message)
        if not owner:
            return
        alike = (room.owner == owner and room.reserved == reserved for room in self._live)
        own, settings = sum(alike), self._settings
        if reserved and own >= settings.max_reserved_per_owner:
            message = f"{own} of your episodes wait for their first player; close one of them first"
            raise ProtocolError("rate/episodes", message)
        if not reserved and own >= settings.max_episodes_per_owner:
            message = f"{own} of your episodes run already; end one of them first"
            raise ProtocolError("rate/episodes", message)

    def _open(self, setup: EpisodeSetup, owner: str) -> Room:
        task, rules = setup.task, setup.rules
        episode_id = self._worker.mark_id(self._random.getrandbits(64))
        code = self._new_code()
        world = shared_world(task)
        created = self._timestamp()
        head = header(
            task, rules, episode=episode_id, seed=setup.seed, created=created, code=code,
            owner=owner, labels=setup.labels, treatments=setup.treatments,
            open_until=self._open_until(rules),
        )  # fmt: skip
        recorder = Recorder(world, wall=self._wall)
        journal = None
        if self._storage is not None:
            name = file_name(created, task.name, episode_id)
            journal = Journal(self._storage, name, recorder, begin=recorder.begin(head))
            if not journal.write():
                journal.discard()
                raise ProtocolError("server/recording", f"no episode: {journal.problem}")
        episode = Episode(world, rules, self._host.timers.time(), treatments=setup.treatments)
        room = self._room(head, code, episode, recorder, journal)
        get_logger().info(
            "episode opened", episode=episode_id, code=code, task=task.name, clock=rules.clock.value
        )
        return room

    def _open_until(self, rules: Rules) -> int | None:
        """When nobody who has not come needs to come any more, in milliseconds since 1970."""
        return None if rules.open_for is None else round((self._wall() + rules.open_for) * 1000)

    def _room(
        self,
        head: Mapping[str, Any],
        code: str,
        episode: Episode,
        recorder: Recorder,
        journal: Journal | None,
    ) -> Room:
        now, episode_id = self._host.timers.time, head["episode"]
        broadcaster = Broadcaster(episode_id, code, episode, recorder.writer, self._metrics, now)
        room = Room(
            episode_id,
            code,
            episode,
            journal=journal,
            broadcaster=broadcaster,
            host=self._host,
            owner=head.get("owner", ""),
            labels=head.get("labels", {}),
            created=head["created"],
            seed=head["seed"],
        )
        self.rooms[episode_id] = room
        self._codes[plain_code(code)] = room
        if episode.phase is not Phase.ENDED:
            self._live.add(room)
            if journal is not None:
                self._inspection.begin()
                self._round_trips.begin()
        self._count()
        if self._host.observer is not None and room in self._live:
            self._host.observer.opened(room)
        room.flush()
        return room

    # Going on after a restart

    def recover(self) -> None:
        """Go on with the episodes that another process has left."""
        if self._recovery is not None:
            self._recovery.look(self.rooms)

    def opened(self) -> None:
        """The server can be reached now: only from here on is anybody late."""
        now = self._host.timers.time()
        for room in self.rooms.values():
            room.episode.renew_patience(now, self._settings.recovery_seconds)
            room.flush()

    @property
    def draining(self) -> bool:
        """Whether this process leaves its episodes to the next one."""
        return self._draining

    def drain(self) -> None:
        """Open no more episodes, and take none over."""
        self._draining = True
        if self._recovery is not None:
            self._recovery.stop()

    @property
    def unrestored(self) -> dict[str, str]:
        """Recordings that cannot be gone on with, or not yet, and why."""
        if self._recovery is None:
            return {}
        return {**self._recovery.unrestored, **self._recovery.problems}

    def _adopt(self, found: ArchivedEpisode) -> Room:
        """A room for an episode that began in another process."""
        head = found.head
        episode, code = found.restored.episode, head.get("code") or self._new_code()
        if (until := head.get("open_until")) is not None and episode.rules.open_for is not None:
            now = self._host.timers.time()
            episode.opened_at(now + until / 1000 - self._wall() - episode.rules.open_for, now)
        room = self._room(head, code, episode, found.recorder, found.journal)
        room.broadcaster.restore_chat(found.restored.said)
        if found.journal is None:
            room.suspend()
            self._linger(room)
            return room
        self._metrics.restored.inc()
        step = room.episode.step
        get_logger().info("episode restored", episode=room.id, code=room.code, step=step)
        return room

    # Finding

    def find(self, name: str) -> Room:
        """The room of an id or a code; ProtocolError `episode/unknown` if there is none."""
        room = self._known(name) or self._found_elsewhere(name)
        if room is None:
            self._unused.check(name)
            message = f"no episode has the id or code {name!r}"
            raise ProtocolError("episode/unknown", message, "episode")
        return room

    def home_of(self, session: str, episode: str) -> Room | None:
        """The room of a resume token: where it was made, or where its session was given a seat
        after that and before a restart."""
        if self._recovery is not None:
            seated = self._recovery.seated(session)
            if seated is not None:
                return seated
        if not episode:
            return None
        return self.rooms.get(episode) or self._found_elsewhere(episode)

    def may_have_ended(self, episode: str) -> bool:
        """Whether an episode without a room may be over: `show_end` finds out."""
        return self._recovery is not None and self._recovery.archive.may_have(episode)

    async def show_end(self, episode: str) -> None:
        """Make a room again of an episode, if it is over; ProtocolError if that takes too long."""
        if self._recovery is not None and episode not in self.rooms:
            await self._recovery.archive.show(episode)

    def _known(self, name: str) -> Room | None:
        return self.rooms.get(name) or self._codes.get(plain_code(name))

    def _found_elsewhere(self, name: str) -> Room | None:
        """A room that has just been handed over; an error if another process has it."""
        self._worker.check_here(name, plain_code(name), CODE_LENGTH)
        if self.draining or (
            self._recovery is not None and self._recovery.elsewhere(name, self.rooms)
        ):
            message = "this episode is being handed over; try again in a moment"
            raise ProtocolError("server/handover", message, "episode")
        return self._known(name)

    def infos(
        self, request: messages.ListEpisodes, only: str, owner: str, *, operator: bool
    ) -> messages.Episodes:
        """All rooms, those that wait for players first; or that of one id or code (`only`). Labels
        are told to who has opened the episode, and to operators."""
        wanted = request.labels.items()
        if request.closed:
            closed = [
                one.info
                for one in self._unused
                if (operator or one.owner == owner) and wanted <= one.info.labels.items()
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
        """End an episode; ProtocolError `episode/unknown` or `auth/episode` if it is not there, or
        another's."""
        room = self.find(name)
        if not operator and room.owner != owner:
            message = "you have not opened this episode; its host or an operator can close it"
            raise ProtocolError("auth/episode", message, "episode")
        room.abort(reason)
        return room

    def _closed(self, room: Room) -> None:
        """An episode is over: keep its room for a while, for those who come back late."""
        self._live.discard(room)
        self._count()
        if room.reserved:
            self._unused.add(UnusedCode(info(room, room.labels), room.owner))
            get_logger().info("episode closed unused", episode=room.id, code=room.code)
        loop = asyncio.get_running_loop()
        if room.journal is not None:
            kept = room.episode.used or room.reserved or bool(room.labels)
            finish = partial(_finish, room.journal, kept=kept)
            closing = loop.run_in_executor(None, finish)
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)
            closing.add_done_callback(partial(_name_recording, room))
        self._linger(room)

    def _linger(self, room: Room) -> None:
        self._rematches.add(room)
        seconds = max(LINGER_SECONDS, room.episode.rules.grace)
        loop = asyncio.get_running_loop()
        self._lingering[room] = loop.call_later(seconds, self._forget, room)

    async def closed(self) -> None:
        """Wait until all recordings that are over are closed, and no bot decides any more."""
        await self._bot_scheduler.close()
        if self._closing:
            await asyncio.wait(self._closing)

    def suspend(self, episode: str) -> list[Session]:
        """Leave an episode to another process, unless that was done before; who was in it."""
        room = self.rooms.get(episode)
        if room is None:
            return []
        room.suspend()
        self._drop(room)
        return list(room.members)

    def stop(self) -> None:
        """Look after nothing any more."""
        self._host.timers.clear()
        self._inspection.stop()
        self._round_trips.stop()
        if self._recovery is not None:
            self._recovery.archive.stop()
        for timer in self._lingering.values():
            timer.cancel()
        self._lingering.clear()

    def _forget(self, room: Room) -> None:
        self._lingering.pop(room, None)
        self._drop(room)
        for session in list(room.members):
            if session.peer is None:
                self._host.vacated(session)
        room.dismiss()

    def _drop(self, room: Room) -> None:
        self.rooms.pop(room.id, None)
        self.dropped += 1
        self._live.discard(room)
        self._codes.pop(plain_code(room.code), None)
        if self._recovery is not None:
            self._recovery.forget(room)
        self._count()

    def _count(self) -> None:
        self._metrics.episodes.set(len(self._live))

    def _new_code(self) -> str:
        while True:
            letters = [self._random.choice(CODE_LETTERS) for _ in range(CODE_LENGTH)]
            letters[0] = self._worker.mark_letter(letters[0])
            if "".join(letters) not in self._codes:
                half = CODE_LENGTH // 2
                return f"{''.join(letters[:half])}-{''.join(letters[half:])}"


def _inspect(room: Room) -> bool:
    """Whether somebody has removed or cut the file that is written, which is mended."""
    return room.journal is not None and room.journal.look()


def _finish(journal: Journal, *, kept: bool) -> str:
    """Close a recording, or delete it where nobody ever took part, or was expected to."""
    if kept:
        return journal.close()
    journal.discard()
    return ""


def _name_recording(room: Room, closing: asyncio.Future[str]) -> None:
    if not closing.cancelled() and closing.exception() is None:
        room.recording = closing.result()
