"""The lobby: open rooms, find them by id or code, close them when they are over."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from robotouille.domain.catalogue import load_task
from robotouille.domain.task import Task
from robotouille.episode import Episode, Phase, Rules
from robotouille.errors import (
    FileError,
    ProtocolError,
    RecordingError,
    RobotouilleError,
    UnknownTaskError,
)
from robotouille.protocol import messages
from robotouille.replay.frames import MAGIC, read_frames
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restore
from robotouille.world.world import shared_world
from robotouille_server.audience import Audience
from robotouille_server.journal import OPEN, Journal, close_recording, file_name
from robotouille_server.logs import get_logger
from robotouille_server.metrics import Metrics
from robotouille_server.room import Room, RoomHost
from robotouille_server.session import Session
from robotouille_server.settings import ServerSettings
from robotouille_server.storage import Appender, Storage
from robotouille_server.workers import Worker

__all__ = ["CODE_LENGTH", "Lobby"]

# Without letters that are taken for one another.
CODE_LETTERS = "ABCDEFGHJKMNPQRSTUVWXYZ"
CODE_LENGTH = 10
LINGER_SECONDS = 120.0
TAKE_OVER_SECONDS = 0.5
"""Between two looks at the episodes that another process still has."""


@dataclass(frozen=True, slots=True)
class Foreign:
    """An episode that another process is about to hand over."""

    name: str
    episode: str
    code: str


class Lobby:
    """All rooms of a server. `random` names them; `timestamp` says when, for recordings."""

    def __init__(
        self,
        settings: ServerSettings,
        metrics: Metrics,
        randomness: random.Random,
        timestamp: Callable[[], str],
        *,
        storage: Storage | None,
        worker: Worker,
        resume_token: Callable[[Session], str],
        vacated: Callable[[Session], None],
    ) -> None:
        self.rooms: dict[str, Room] = {}
        self.draining = False
        self.unrestored: dict[str, str] = {}
        self._codes: dict[str, Room] = {}
        self._foreign: dict[str, Foreign] = {}
        self._seated: dict[str, Room] = {}
        self._settings = settings
        self._metrics = metrics
        self._random = randomness
        self._timestamp = timestamp
        self._storage = storage
        self._worker = worker
        self._closing: set[asyncio.Future[str]] = set()
        self._looking: asyncio.TimerHandle | None = None
        self._lingering: dict[Room, asyncio.TimerHandle] = {}
        self._host = RoomHost(metrics, resume_token, vacated, self._closed)

    # Opening

    def create(self, request: messages.Create, *, owner: str = "") -> Room:
        """Open a room; ProtocolError names what cannot be had."""
        self._check_room(owner)
        rules = self._rules(request)
        seed = request.seed if request.seed is not None else self._settings.seed
        task = self._task(request, rules, seed)
        return self._open(task, rules, seed, owner)

    def _check_room(self, owner: str) -> None:
        if self.draining:
            message = "this server is about to be restarted; try again in a moment"
            raise ProtocolError("server/draining", message)
        live = [room for room in self.rooms.values() if room.episode.phase is not Phase.OVER]
        if len(live) >= self._settings.max_episodes:
            message = f"{len(live)} episodes run already; try again later"
            raise ProtocolError("server/full", message)
        own = sum(room.owner == owner for room in live) if owner else 0
        if own >= self._settings.max_episodes_per_owner:
            message = f"{own} of your episodes run already; end one of them first"
            raise ProtocolError("rate/episodes", message)

    def _open(self, task: Task, rules: Rules, seed: int, owner: str) -> Room:
        episode_id = self._worker.mark_id(self._random.getrandbits(64))
        code = self._new_code()
        world = shared_world(task)
        created = self._timestamp()
        head = header(
            task, rules, episode=episode_id, seed=seed, created=created, code=code, owner=owner
        )
        recorder = Recorder(world, head)
        journal = None
        if self._storage is not None:
            journal = Journal(self._storage, file_name(created, task.name, episode_id), recorder)
            if not journal.write():
                raise ProtocolError("server/recording", f"no episode: {journal.problem}")
        episode = Episode(world, rules, asyncio.get_running_loop().time())
        room = self._room(episode_id, code, owner, episode, recorder, journal)
        get_logger().info(
            "episode opened", episode=episode_id, code=code, task=task.name, clock=rules.clock.value
        )
        return room

    def _room(
        self,
        episode_id: str,
        code: str,
        owner: str,
        episode: Episode,
        recorder: Recorder,
        journal: Journal | None,
    ) -> Room:
        now = asyncio.get_running_loop().time
        audience = Audience(episode_id, code, episode, recorder.writer, self._metrics, now)
        room = Room(
            episode_id,
            code,
            episode,
            journal=journal,
            audience=audience,
            host=self._host,
            owner=owner,
        )
        self.rooms[episode_id] = room
        self._codes[_plain(code)] = room
        self._count()
        room.flush()
        return room

    # Going on after a restart

    def recover(self) -> None:
        """Go on with every episode whose recording is not closed; those that another process
        still writes are taken over when it lets go."""
        if self._storage is None:
            return
        names = [name for name in self._storage.names() if name.endswith(OPEN)]
        for name in names:
            if name not in self.unrestored and self._worker.owns(_episode_of(name)):
                self._take_over(self._storage, name)
        if self._foreign and self._looking is None:
            loop = asyncio.get_running_loop()
            self._looking = loop.call_later(TAKE_OVER_SECONDS, self._look_again)

    def _look_again(self) -> None:
        self._looking = None
        self.recover()

    def _take_over(self, storage: Storage, name: str) -> None:
        if _episode_of(name) in self.rooms:
            return
        try:
            file = storage.resume(name)
        except FileNotFoundError:
            self._foreign.pop(name, None)
            return
        except BlockingIOError:
            self._note_foreign(storage, name)
            return
        except OSError as error:
            self._give_up(name, f"cannot be opened: {error.strerror or error}")
            return
        self._foreign.pop(name, None)
        try:
            if not self._restore(storage, name, file):
                file.close()
        except FileNotFoundError:
            file.close()  # Whoever had it has just closed the recording.
        except (RobotouilleError, OSError) as error:
            file.close()
            self._give_up(name, str(error))

    def _restore(self, storage: Storage, name: str, file: Appender) -> bool:
        """Make a room of a file; whether it keeps the file."""
        content = storage.read(name)
        if MAGIC.startswith(content[: len(MAGIC)]) and not any(read_frames(content)):
            storage.remove(name)  # Cut off in its header: nobody was told of it.
            return False
        recording = Recording(content, name)
        now = asyncio.get_running_loop().time()
        found = restore(recording, now, self._settings.recovery_seconds, shared_world)
        file.cut(found.kept)
        if found.missing:
            file.append(found.missing)
        if found.complete:
            close_recording(storage, name)
            return False
        self._reopen(storage, name, file, recording, found)
        return True

    def _reopen(
        self, storage: Storage, name: str, file: Appender, recording: Recording, found: Restored
    ) -> None:
        head = recording.header
        recorder = Recorder(found.episode.world, head)
        journal = Journal(storage, name, recorder, found=file)
        code = head.get("code") or self._new_code()
        room = self._room(
            head["episode"], code, head.get("owner", ""), found.episode, recorder, journal
        )
        room.audience.remember(found.said)
        for seat in found.episode.seats.values():
            if seat.taken:
                self._seated[seat.session] = room
        self._metrics.restored.inc()
        get_logger().info(
            "episode restored", episode=room.id, code=code, step=found.episode.step, file=name
        )

    def _note_foreign(self, storage: Storage, name: str) -> None:
        if name in self._foreign:
            return
        try:
            head = next(read_frames(storage.read(name)), {})
        except (OSError, RecordingError):
            head = {}
        self._foreign[name] = Foreign(name, _episode_of(name), str(head.get("code", "")))

    def _give_up(self, name: str, reason: str) -> None:
        self.unrestored[name] = reason
        get_logger().error("episode not restored", file=name, error=reason)

    # Finding

    def find(self, name: str) -> Room:
        """The room of an id or a code; ProtocolError `episode/unknown` if there is none."""
        room = self._known(name) or self._found_elsewhere(name)
        if room is None:
            message = f"no episode has the id or code {name!r}"
            raise ProtocolError("episode/unknown", message, "episode")
        return room

    def home_of(self, session: str, episode: str) -> Room | None:
        """The room of a resume token: where it was made, or where its session was given a seat
        after that and before a restart."""
        seated = self._seated.get(session)
        if seated is not None and seated.holds_seat(session) is not None:
            return seated
        if not episode:
            return None
        return self.rooms.get(episode) or self._found_elsewhere(episode)

    def _known(self, name: str) -> Room | None:
        return self.rooms.get(name) or self._codes.get(_plain(name))

    def _found_elsewhere(self, name: str) -> Room | None:
        """A room that has just been handed over; an error if another process has it."""
        self._worker.check_here(name, _plain(name), CODE_LENGTH)
        if self._foreign:
            self.recover()
        for foreign in self._foreign.values():
            if name == foreign.episode or _plain(name) == _plain(foreign.code):
                message = "this episode is being handed over; try again in a moment"
                raise ProtocolError("server/handover", message, "episode")
        return self._known(name)

    def infos(self) -> list[messages.EpisodeInfo]:
        """All rooms, those that wait for players first."""
        order = {Phase.WAITING: 0, Phase.RUNNING: 1, Phase.OVER: 2}
        rooms = sorted(self.rooms.values(), key=lambda room: order[room.episode.phase])
        return [info(room) for room in rooms[:500]]

    # Closing

    def _closed(self, room: Room) -> None:
        """An episode is over: keep its room for a while, for those who come back late."""
        self._count()
        loop = asyncio.get_running_loop()
        if room.journal is not None:
            finish = partial(_finish, room.journal, used=room.episode.used)
            closing = loop.run_in_executor(None, finish)
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)
            closing.add_done_callback(partial(_name_recording, room))
        linger = max(LINGER_SECONDS, room.episode.rules.grace)
        self._lingering[room] = loop.call_later(linger, self._forget, room)

    async def closed(self) -> None:
        """Wait until all recordings that are over are closed."""
        if self._closing:
            await asyncio.wait(self._closing)

    def suspend(self, room: Room) -> None:
        """Leave an episode to another process."""
        room.suspend()
        self._drop(room)

    def stop(self) -> None:
        """Look after nothing any more."""
        for timer in (self._looking, *self._lingering.values()):
            if timer is not None:
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
        self._codes.pop(_plain(room.code), None)
        self._seated = {name: home for name, home in self._seated.items() if home is not room}
        self._count()

    def _count(self) -> None:
        live = sum(room.episode.phase is not Phase.OVER for room in self.rooms.values())
        self._metrics.episodes.set(live)

    # What is asked for

    def _rules(self, request: messages.Create) -> Rules:
        asked = {
            "clock": request.clock,
            "step_rate": request.step_rate,
            "move_budget": request.move_budget,
            "max_steps": request.max_steps,
            "thinking": request.thinking,
            "absence": request.absence,
            "stand_in": request.stand_in,
            "grace": request.grace,
        }
        changes = {key: value for key, value in asked.items() if value is not None}
        return self._settings.rules().model_copy(update=changes)

    def _task(self, request: messages.Create, rules: Rules, seed: int) -> Task:
        name = request.task or self._settings.task
        timing = request.timing or self._settings.timing_for(rules.clock)
        seats = request.seats if request.seats is not None else self._settings.seats
        if request.task is not None and request.seats is None:
            seats = None
        try:
            return load_task(
                name, seats=seats, timing=timing, seed=seed, files=request.task is None
            )
        except UnknownTaskError as error:
            raise ProtocolError("task/unknown", str(error), "task") from None
        except FileError as error:
            fault = error.faults[0]
            field = "seats" if fault.path == "seats" else "task"
            raise ProtocolError("task/invalid", str(fault), field) from None

    def _new_code(self) -> str:
        while True:
            letters = [self._random.choice(CODE_LETTERS) for _ in range(CODE_LENGTH)]
            letters[0] = self._worker.mark_letter(CODE_LETTERS, letters[0])
            if "".join(letters) not in self._codes:
                half = CODE_LENGTH // 2
                return f"{''.join(letters[:half])}-{''.join(letters[half:])}"


def info(room: Room) -> messages.EpisodeInfo:
    """A room as the lobby lists it."""
    rules = room.episode.rules
    return messages.EpisodeInfo(
        episode=room.id,
        code=room.code,
        task=room.world.task.name,
        clock=rules.clock.value,
        phase=room.audience.phase,
        step=room.episode.step,
        max_steps=rules.max_steps,
        seats=room.audience.seats(),
        spectators=room.spectators,
    )


def _plain(code: str) -> str:
    return code.strip().replace("-", "").upper()


def _episode_of(name: str) -> str:
    """The episode's id in a recording's name."""
    return name.removesuffix(OPEN).rpartition("_")[2]


def _finish(journal: Journal, *, used: bool) -> str:
    """Close a recording, or delete it where nobody ever took part."""
    if used:
        return journal.close()
    journal.discard()
    return ""


def _name_recording(room: Room, closing: asyncio.Future[str]) -> None:
    if not closing.cancelled() and closing.exception() is None:
        room.recording = closing.result()
