"""Stream of episode events for the broker: watches, a bounded queue, and the observer of rooms."""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Callable, Collection, Container, Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import Any, NamedTuple

from pydantic import BaseModel

from robotouille.episode import EpisodeEnded, Event, Paused, Restarted, Resumed, Started, Stepped
from robotouille.errors import ProtocolError
from robotouille_server.mqtt.messages import LifecycleEvent, Topics
from robotouille_server.mqtt.packets import publish_bytes
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics

MAX_WATCHES = 100
"""Maximum number of watches on one server."""
MAX_MESSAGES = 10_000
"""Maximum number of queued messages, each of a few KiB at most."""
MAX_STEPS = 20_000
"""Maximum number of queued steps: 20 s of 200 episodes at 5 steps per second, about 20 MB."""
MAX_STEPS_A_MESSAGE = 100


@dataclass(frozen=True, slots=True)
class Watch:
    """Request for the steps of one episode, or of all episodes with some labels.

    Attributes:
        subject: The subject of the token.
        owner: The only subject whose episodes are included, or None for all.
        token_id: The id of the token. The watch ends when the token is revoked.
    """

    subject: str
    owner: str | None
    episode: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    token_id: str = ""

    def matches(self, room: Room) -> bool:
        """Return whether the watch includes a room's episode."""
        if self.owner is not None and room.owner != self.owner:
            return False
        return self.episode in ("", room.id) and self.labels.items() <= room.labels.items()

    @property
    def key(self) -> object:
        """Identity of the watch. A new watch replaces the one with the same key."""
        return self.subject, self.episode, frozenset(self.labels.items())


class Watches:
    """All watches of a server.

    Args:
        rooms: Returns the server's rooms.
        revoked: The ids of revoked tokens.

    Attributes:
        episodes: The ids of the watched episodes. Kept as a set because every step checks it.
    """

    def __init__(self, rooms: Callable[[], Collection[Room]], revoked: Container[str] = ()) -> None:
        self.episodes: set[str] = set()
        self._rooms = rooms
        self._revoked = revoked
        self._watches: dict[object, tuple[Watch, float]] = {}

    def add(self, watch: Watch, until: float) -> None:
        """Add or extend a watch.

        Raises:
            ProtocolError: `rate/limited`: there are too many watches.
        """
        if watch.key not in self._watches and len(self._watches) >= MAX_WATCHES:
            message = f"the server has {MAX_WATCHES} watches; end one with unwatch"
            raise ProtocolError("rate/limited", message)
        self._watches[watch.key] = watch, until
        self._update_episodes()

    def remove(self, watch: Watch) -> int:
        """End a watch, or all of its subject if it names nothing, and return how many ended."""
        everything = not watch.episode and not watch.labels
        return self._remove_if(
            lambda other, _: (
                other.key == watch.key or (everything and other.subject == watch.subject)
            )
        )

    def expire(self, now: float) -> None:
        """End the watches whose time is up or whose token was revoked."""
        self._remove_if(lambda watch, until: until <= now or watch.token_id in self._revoked)

    def opened(self, room: Room) -> None:
        """Include a new room if a watch matches it."""
        if any(watch.matches(room) for watch, _ in self._watches.values()):
            self.episodes.add(room.id)

    def _remove_if(self, condition: Callable[[Watch, float], bool]) -> int:
        ended = [key for key, (watch, until) in self._watches.items() if condition(watch, until)]
        for key in ended:
            del self._watches[key]
        if ended:
            self._update_episodes()
        return len(ended)

    def _update_episodes(self) -> None:
        self.episodes.clear()
        for room in self._rooms():
            if not room.episode.ended:
                self.opened(room)


class OutgoingMessage(NamedTuple):
    """Message to publish at least once.

    Attributes:
        refusal: The payload to publish if the packet is larger than the broker accepts. The message
            is dropped if it is empty.
    """

    topic: str
    payload: bytes
    correlation: bytes | None = None
    refusal: bytes = b""

    def within(self, largest: float) -> OutgoingMessage | None:
        """Return the message, or what replaces it if its packet is larger than a limit."""
        for payload in filter(None, (self.payload, self.refusal)):
            if publish_bytes(self.topic, payload, self.correlation) <= largest:
                return self._replace(payload=payload)
        return None


class StepRecord(NamedTuple):
    """Step to publish at most once: the JSON of a `StepRow`, which keeps no state alive."""

    episode: str
    row: dict[str, Any]


class Outbox:
    """Bounded queue of messages and steps. If it is full, the oldest are dropped and counted.

    Steps have their own queue, so that they never displace messages.
    """

    def __init__(self, metrics: Metrics) -> None:
        self.messages: deque[OutgoingMessage] = deque()
        self._steps: deque[StepRecord] = deque()
        self._dropped: Counter[str] = Counter()
        self._metrics = metrics

    def add(self, message: OutgoingMessage) -> None:
        """Queue a message."""
        if len(self.messages) >= MAX_MESSAGES:
            self.messages.popleft()
            self._metrics.mqtt_dropped_messages += 1
        self.messages.append(message)

    def add_step(self, step: StepRecord) -> None:
        """Queue a step."""
        if len(self._steps) >= MAX_STEPS:
            self.drop([self._steps.popleft()])
        self._steps.append(step)

    def take_steps(self) -> deque[list[StepRecord]]:
        """Remove and return all steps: lists of consecutive steps of one episode."""
        taken: dict[str, list[StepRecord]] = {}
        for step in self._steps:
            taken.setdefault(step.episode, []).append(step)
        self._steps.clear()
        size = MAX_STEPS_A_MESSAGE
        return deque(s[at : at + size] for s in taken.values() for at in range(0, len(s), size))

    def dropped(self, episode: str) -> int:
        """Return the number of dropped steps that no published message has reported."""
        return self._dropped[episode]

    def dropped_reported(self, episode: str, number: int) -> None:
        """Forget dropped steps, because a published message has reported them."""
        # More may have been dropped while the message was published.
        self._dropped[episode] -= number

    def drop(self, steps: list[StepRecord]) -> None:
        """Count steps that will not be published."""
        self._metrics.mqtt_dropped_steps += len(steps)
        self._dropped.update(step.episode for step in steps)

    def forget_all_but(self, watched: set[str]) -> None:
        """Forget the dropped steps of all other episodes."""
        for episode in self._dropped.keys() - watched:
            del self._dropped[episode]


def steps_payload(steps: list[StepRecord], dropped: int) -> bytes:
    """Return the JSON of an `EpisodeSteps`, with the number of steps dropped before."""
    # Ten times as fast as pydantic.
    rows = [step.row for step in steps]
    content: dict[str, Any] = {"episode": steps[0].episode, "steps": rows}
    if dropped:
        content["dropped"] = dropped
    return json.dumps(content, separators=(",", ":")).encode()


def encode(content: BaseModel) -> bytes:
    """Return the JSON of a message without default values."""
    plain = content.model_dump(mode="json", exclude_defaults=True)
    # Names may contain lone surrogates, which UTF-8 cannot encode: `replace` writes "?".
    return json.dumps(plain, separators=(",", ":"), ensure_ascii=False).encode(errors="replace")


class RoomStream:
    """`RoomObserver` that queues lifecycle events, and the steps of watched episodes.

    It runs inside a room's step, so it only builds and queues messages. Events reach it after they
    were written, so the broker never receives what is not on disk. `wall` returns the seconds since
    1970.
    """

    def __init__(
        self, outbox: Outbox, watches: Watches, topics: Topics, wall: Callable[[], float]
    ) -> None:
        self._outbox = outbox
        self._watches = watches
        self._topics = topics
        self._wall = wall
        self._numbers = count(1)

    def opened(self, room: Room) -> None:
        """Queue the event of a room that was opened or restored."""
        try:
            self._watches.opened(room)
            self._add(room, event="opened")
        except Exception:
            _log_failure(room)

    def published(self, room: Room, events: list[Event]) -> None:
        """Queue committed events."""
        try:
            watched = room.id in self._watches.episodes
            for event in events:
                if type(event) is not Stepped:
                    self._add_change(room, event)
                elif watched:
                    self._add_step(room, event)
        except Exception:
            _log_failure(room)

    def _add_step(self, room: Room, event: Stepped) -> None:
        moves = [
            {
                "player": move.player,
                "action": [move.action.name, *move.action.arguments],
                "applied": attempt.applied,
                "ms": round(move.latency * 1000),
            }
            for move, attempt in zip(event.moves, event.attempts, strict=True)
        ]
        t, utc_ms = round(event.time * 1000), round(self._wall() * 1000)
        row = {"step": event.step, "t": t, "utc_ms": utc_ms, "moves": moves}
        self._outbox.add_step(StepRecord(room.id, row))

    def _add_change(self, room: Room, event: Event) -> None:
        match event:
            case Started() | Resumed() | Restarted():
                self._add(room, event=type(event).__name__.lower())
            case Paused(reasons):
                self._add(room, event="paused", reasons=[reason.value for reason in reasons])
            case EpisodeEnded(outcome):
                change = "ended" if room.episode.record.used else "closed"
                self._add(room, event=change, outcome=outcome.to_json())
                self._watches.episodes.discard(room.id)

    def _add(self, room: Room, **what: Any) -> None:
        change = LifecycleEvent(
            number=next(self._numbers),
            episode=room.id,
            utc_ms=round(self._wall() * 1000),
            task=room.world.task.name,
            clock=room.episode.rules.clock.value,
            step=room.episode.step,
            labels=dict(room.labels),
            **what,
        )
        self._outbox.add(OutgoingMessage(self._topics.life(room.id), encode(change)))


def _log_failure(room: Room) -> None:
    # An error here must not end the episode.
    get_logger().exception("MQTT: an event was not queued", episode=room.id)
