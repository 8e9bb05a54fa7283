"""The lobby: open rooms, find them by id or code, close them when they are over."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable

from robotouille.domain.catalogue import load_task
from robotouille.domain.task import Task
from robotouille.episode import Episode, Phase, Rules
from robotouille.errors import FileError, ProtocolError, UnknownTaskError
from robotouille.protocol import messages
from robotouille.replay.recorder import Recorder, header
from robotouille.world.world import shared_world
from robotouille_server.files import RecordingFile
from robotouille_server.logs import get_logger
from robotouille_server.metrics import Metrics
from robotouille_server.room import Room
from robotouille_server.settings import ServerSettings

__all__ = ["Lobby"]

# Without letters and digits that are taken for one another.
CODE_LETTERS = "ABCDEFGHJKMNPQRSTUVWXYZ"
CODE_LENGTH = 5
LINGER_SECONDS = 120.0


class Lobby:
    """All rooms of a server. `random` names them; `timestamp` says when, for recordings."""

    def __init__(
        self,
        settings: ServerSettings,
        metrics: Metrics,
        randomness: random.Random,
        timestamp: Callable[[], str],
    ) -> None:
        self.rooms: dict[str, Room] = {}
        self._codes: dict[str, Room] = {}
        self._settings = settings
        self._metrics = metrics
        self._random = randomness
        self._timestamp = timestamp

    def create(self, request: messages.Create, now: float) -> Room:
        """Open a room; ProtocolError names what cannot be had."""
        live = sum(room.episode.phase is not Phase.OVER for room in self.rooms.values())
        if live >= self._settings.max_episodes:
            message = f"{live} episodes run already; try again later"
            raise ProtocolError("server/full", message)
        rules = self._rules(request)
        seed = request.seed if request.seed is not None else self._settings.seed
        task = self._task(request, rules, seed)
        return self._open(task, rules, seed, now)

    def _open(self, task: Task, rules: Rules, seed: int, now: float) -> Room:
        episode_id = f"{self._random.getrandbits(64):016x}"
        code = self._new_code()
        world = shared_world(task)
        created = self._timestamp()
        head = header(task, rules, episode=episode_id, seed=seed, created=created)
        file = None
        if self._settings.record:
            stem = f"{created}_{task.name}_{episode_id}"
            file = RecordingFile(self._settings.recordings, stem)
        episode = Episode(world, rules, now)
        room = Room(
            episode_id,
            code,
            episode,
            recorder=Recorder(world, head),
            file=file,
            metrics=self._metrics,
            on_close=self._closed,
        )
        self.rooms[episode_id] = room
        self._codes[code] = room
        self._count()
        get_logger().info(
            "episode opened", episode=episode_id, code=code, task=task.name, clock=rules.clock.value
        )
        return room

    def find(self, name: str) -> Room:
        """The room of an id or a code; ProtocolError `episode/unknown` if there is none."""
        room = self.rooms.get(name) or self._codes.get(name.strip().upper())
        if room is None:
            message = f"no episode has the id or code {name!r}"
            raise ProtocolError("episode/unknown", message, "episode")
        return room

    def infos(self) -> list[messages.EpisodeInfo]:
        """All rooms, those that wait for players first."""
        order = {Phase.WAITING: 0, Phase.RUNNING: 1, Phase.OVER: 2}
        rooms = sorted(self.rooms.values(), key=lambda room: order[room.episode.phase])
        return [room.info() for room in rooms[:500]]

    def _closed(self, room: Room) -> None:
        """An episode is over: keep its room for a while, for those who come back late."""
        self._count()
        linger = max(LINGER_SECONDS, self._settings.grace)
        asyncio.get_running_loop().call_later(linger, self._forget, room)

    def _forget(self, room: Room) -> None:
        self.rooms.pop(room.id, None)
        self._codes.pop(room.code, None)
        room.dismiss()

    def _count(self) -> None:
        live = sum(room.episode.phase is not Phase.OVER for room in self.rooms.values())
        self._metrics.episodes.set(live)

    def _rules(self, request: messages.Create) -> Rules:
        asked = {
            "clock": request.clock,
            "step_rate": request.step_rate,
            "move_budget": request.move_budget,
            "max_steps": request.max_steps,
            "thinking": request.thinking,
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
            code = "".join(self._random.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))
            if code not in self._codes:
                return code
