"""Factory of rooms, and the join codes with which participants find them."""

from __future__ import annotations

import random
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Protocol

from robotouille.episode import Episode, Rules
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.join_codes import plain_code
from robotouille.replay.file_names import file_name
from robotouille.replay.recorder import HeaderDetails, Recorder, header
from robotouille.world.world import shared_world
from robotouille_server.rooms.episode_driver import Machinery
from robotouille_server.rooms.episode_setup import EpisodeSetup
from robotouille_server.rooms.recording.archive import ArchivedEpisode
from robotouille_server.rooms.recording.journal import EpisodeJournal, Journal
from robotouille_server.rooms.recording.storage import Storage
from robotouille_server.rooms.room import Room, RoomFacts, RoomKeeper
from robotouille_server.rooms.substitutes.bot_worker import BotWorker, ProcessBotWorker
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import CODE_LETTERS, WorkerSlot

if TYPE_CHECKING:
    from robotouille_server.rooms.participants.sessions import Sessions

CODE_LENGTH = 10
"""Letters of a code: 23 ** 10 codes are too many to guess, given the limit on wrong codes."""
MAX_CODES = 10_000
"""Codes closed without use that a process remembers."""


@dataclass(frozen=True, slots=True)
class UnusedCode:
    """Code that nobody has used, with the last description of its episode."""

    info: messages.EpisodeInfo
    owner: str


class JoinCodes:
    """Codes of a process: those of its rooms, and the latest ones that were closed without use."""

    def __init__(self, randomness: random.Random, worker: WorkerSlot) -> None:
        self._random = randomness
        self._worker = worker
        self._rooms: dict[str, Room] = {}
        self._unused: OrderedDict[str, UnusedCode] = OrderedDict()

    def new(self) -> str:
        """Return a code that no room has."""
        while True:
            letters = [self._random.choice(CODE_LETTERS) for _ in range(CODE_LENGTH)]
            # The first letter names the worker, so any worker can send the client to the right one
            # (docs/decisions/0017).
            letters[0] = self._worker.mark_letter(letters[0])
            # A collision is unlikely, but it would make one of two rooms unreachable.
            if "".join(letters) not in self._rooms:
                half = CODE_LENGTH // 2
                return f"{''.join(letters[:half])}-{''.join(letters[half:])}"

    def add(self, room: Room) -> None:
        """Let participants find a room by its code."""
        self._rooms[plain_code(room.code)] = room

    def find(self, code: str) -> Room | None:
        """Return the room with a code; dashes, spaces and case do not matter."""
        return self._rooms.get(plain_code(code))

    def drop(self, room: Room) -> None:
        """Forget the code of a room."""
        self._rooms.pop(plain_code(room.code), None)

    def close_unused(self, unused: UnusedCode) -> None:
        """Remember a code that was closed before anybody used it."""
        # A study may reserve thousands of episodes; memory must stay bounded over weeks.
        while len(self._unused) >= MAX_CODES:
            self._unused.popitem(last=False)
        self._unused[plain_code(unused.info.code)] = unused

    def unused(self) -> Iterator[UnusedCode]:
        """Return the codes that were closed without use, oldest first."""
        return iter(self._unused.values())

    def check_unused(self, code: str) -> None:
        """Raise ProtocolError `episode/ended` for a code that was closed without use."""
        unused = self._unused.get(plain_code(code))
        if unused is not None:
            why = unused.info.detail or "it was closed"
            message = f"the episode {unused.info.code} ended before it began: {why}"
            raise ProtocolError("episode/ended", message, "episode")


def _system_randomness() -> random.Random:
    return random.SystemRandom()


def _timestamp() -> str:
    return datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")


class Cluster(Protocol):
    """Cluster of servers, as its rooms see it; see `ClusterNode`."""

    def journal(self, episode: str, name: str, recorder: Recorder, begin: bytes) -> EpisodeJournal:
        """Return the recording of a new episode, which begins with some bytes."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Sources of time and chance, and other parts of the outside world that tests replace.

    Attributes:
        randomness: Source of ids and codes.
        timestamp: Returns the time in the names of recordings, such as `20250131T120000Z`.
        storage: Where recordings are kept; None for the folder of the settings.
        wall: Returns the seconds since 1970, for tokens, the audit log and recordings.
        worker: The position of this process among several that share a port.
        bot_worker: Makes the worker in which substitutes plan, when the first one is needed.
        cluster: The cluster that stores recordings; None keeps them in files.
    """

    randomness: random.Random = field(default_factory=_system_randomness)
    timestamp: Callable[[], str] = _timestamp
    storage: Storage | None = None
    wall: Callable[[], float] = time.time
    worker: WorkerSlot = field(default_factory=WorkerSlot)
    bot_worker: Callable[[], BotWorker] = ProcessBotWorker
    cluster: Cluster | None = None


class RoomFactory:
    """Makes rooms with their recordings. Without a storage in `around`, rooms are not recorded."""

    def __init__(
        self,
        around: Surroundings,
        codes: JoinCodes,
        machinery: Machinery,
        sessions: Sessions,
        keeper: RoomKeeper,
    ) -> None:
        self._around = around
        self._codes = codes
        self._machinery = machinery
        self._sessions = sessions
        self._keeper = keeper

    def new(self, setup: EpisodeSetup, owner: str, rematch_by: Sequence[str] = ()) -> Room:
        """Return a room for a new episode.

        Args:
            setup: The task and rules.
            owner: The pseudonym of the participant who opens it.
            rematch_by: The session and pseudonym of the player who requested it as a rematch.

        Raises:
            ProtocolError: `server/recording` if its recording cannot be written.
        """
        around, task, rules = self._around, setup.task, setup.rules
        # Ids have 64 random bits, because they are in file names, and servers may share a folder
        # over time.
        episode_id = around.worker.mark_id(around.randomness.getrandbits(64))
        code = self._codes.new()
        # Rooms of one task share the compiled world, because a server may have thousands of rooms
        # (docs/decisions/0019).
        world = shared_world(task)
        created = around.timestamp()
        details = HeaderDetails(
            code, owner, setup.labels, setup.treatments, self._open_until(rules), rematch_by
        )
        head = header(
            task, rules, episode=episode_id, seed=setup.seed, created=created, details=details
        )
        recorder = Recorder(world, around.wall, self._machinery.timers.time)
        journal = self._journal(file_name(created, task.name, episode_id), head, recorder)
        now = self._machinery.timers.time()
        episode = Episode(world, rules, now, treatments=setup.treatments)
        room = self._room(head, code, episode, recorder, journal)
        get_logger().info(
            "episode opened", episode=episode_id, code=code, task=task.name, clock=rules.clock.value
        )
        return room

    def _journal(
        self, name: str, head: dict[str, Any], recorder: Recorder
    ) -> EpisodeJournal | None:
        """Return the recording of a new episode, or None if episodes are not recorded."""
        around = self._around
        if around.cluster is not None:
            return around.cluster.journal(head["episode"], name, recorder, recorder.begin(head))
        if around.storage is None:
            return None
        journal = Journal(around.storage, name, recorder, begin=recorder.begin(head))
        # The header is written before any client knows the code, because an episode whose
        # recording fails at once must not begin.
        if not journal.write():
            journal.discard()
            raise ProtocolError("server/recording", f"no episode: {journal.problem}")
        return journal

    def _open_until(self, rules: Rules) -> int | None:
        """Return the end of a reservation in milliseconds since 1970."""
        if rules.open_for is None:
            return None
        return round((self._around.wall() + rules.open_for) * 1000)

    def restored(self, found: ArchivedEpisode) -> Room:
        """Return a room for an episode that began in another process."""
        head = found.head
        episode, code = found.restored.episode, head.get("code") or self._codes.new()
        if (until := head.get("open_until")) is not None and episode.rules.open_for is not None:
            now = self._machinery.timers.time()
            # The end of the reservation is a time of day, so it does not move when the server
            # restarts.
            opened = now + until / 1000 - self._around.wall() - episode.rules.open_for
            episode.opened_at(opened, now)
        room = self._room(head, code, episode, found.recorder, found.journal)
        # Clients keep the numbers of the chat messages they have seen, so the numbering must
        # continue.
        room.broadcaster.restore_chat(found.restored.said)
        return room

    def _room(
        self,
        head: Mapping[str, Any],
        code: str,
        episode: Episode,
        recorder: Recorder,
        journal: EpisodeJournal | None,
    ) -> Room:
        facts = RoomFacts(
            head["episode"],
            code,
            owner=head.get("owner", ""),
            labels=head.get("labels", {}),
            created=head["created"],
            seed=head["seed"],
        )
        return Room(
            facts,
            episode,
            recorder.writer,
            journal,
            self._machinery,
            self._sessions,
            self._keeper,
        )
