"""What rooms have written, put aside for the broker: no more than that, since it is on the way of
every step."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

from robotouille.episode import Ended, Event, Paused, Restarted, Resumed, Started, Stepped
from robotouille_server.mqtt.models import EpisodeLife
from robotouille_server.mqtt.outbox import Outbox, Outgoing, TakenMove, TakenStep
from robotouille_server.mqtt.topics import Topics
from robotouille_server.mqtt.watches import Watches
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.logs import get_logger

__all__ = ["Tap"]


class Tap:
    """Observes rooms (see `RoomObserver`). `wall` gives the seconds since 1970."""

    def __init__(
        self, outbox: Outbox, watches: Watches, topics: Topics, wall: Callable[[], float]
    ) -> None:
        self._outbox = outbox
        self._watches = watches
        self._topics = topics
        self._wall = wall
        self._numbers = count(1)

    def opened(self, room: Room) -> None:
        """There is a new room, or one that goes on after a restart."""
        self._guarded(self._opened, room)

    def published(self, room: Room, events: list[Event]) -> None:
        """What was written, and is published."""
        watched = room.id in self._watches.episodes
        for event in events:
            if type(event) is Stepped:
                if watched:
                    self._guarded(self._stepped, room, event)
            elif isinstance(event, Started | Paused | Resumed | Restarted | Ended):
                self._guarded(self._lived, room, event)

    def _guarded(self, note: Callable[..., None], room: Room, *event: Event) -> None:
        """A fault here is nobody's who plays."""
        try:
            note(room, *event)
        except Exception:
            get_logger().exception("the broker is not told of an event", episode=room.id)

    def _opened(self, room: Room) -> None:
        self._watches.opened(room)
        self._add(room, event="opened")

    def _stepped(self, room: Room, event: Stepped) -> None:
        moves = tuple(
            TakenMove(move.player, move.action, attempt.applied, round(move.latency * 1000))
            for move, attempt in zip(event.moves, event.attempts, strict=True)
        )
        t, utc_ms = round(event.time * 1000), round(self._wall() * 1000)
        self._outbox.add_step(TakenStep(room.id, event.step, t, utc_ms, moves))

    def _lived(self, room: Room, event: Event) -> None:
        match event:
            case Started():
                self._add(room, event="started")
            case Paused(reasons):
                self._add(room, event="paused", reasons=[reason.value for reason in reasons])
            case Resumed():
                self._add(room, event="resumed")
            case Restarted():
                self._add(room, event="restarted")
            case Ended(outcome):
                what = "ended" if room.episode.used else "closed"
                self._add(room, event=what, outcome=outcome.to_json())
                self._watches.ended(room)

    def _add(self, room: Room, **what: object) -> None:
        life = EpisodeLife(
            number=next(self._numbers),
            episode=room.id,
            utc_ms=round(self._wall() * 1000),
            task=room.world.task.name,
            clock=room.episode.rules.clock.value,
            step=room.episode.step,
            labels=dict(room.labels),
            **what,
        )
        self._outbox.add(Outgoing(self._topics.life(room.id), life))
