"""What follows from each event: who is sent what, what is counted, who loses a place."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robotouille import World
from robotouille.episode import Absence, Clock, Controller, Episode, Event, Rules
from robotouille.protocol.states import StateWriter
from robotouille_server.auth import Role
from robotouille_server.rooms.broadcast.broadcaster import Broadcaster
from robotouille_server.rooms.publisher import Publisher
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.substitutes.bot_scheduler import BotScheduler
from robotouille_server.rooms.substitutes.bot_worker import ThreadBotWorker
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import TimerQueue
from tests.support.executors import ImmediateExecutor
from tests.support.peers import SilentPeer
from tests.support.virtual_time import run

WORLD = World("multi_agent/01")
ADA, BOB = WORLD.players[:2]


class Room:
    """An episode of two, one of whom is connected."""

    def __init__(self, absence: Absence = Absence.WAIT, grace: float = 10.0) -> None:
        rules = Rules(clock=Clock.LOCKSTEP, absence=absence, grace=grace, stand_in="random")
        self.episode = Episode(WORLD, rules, 0.0)
        for player in WORLD.players:
            self.episode.join(player, player, "human", 0.0)
        self.metrics = Metrics()
        self.broadcaster = Broadcaster(
            "e-1", "AAAAA-BBBBB", self.episode, StateWriter(WORLD), self.metrics, lambda: 0.0
        )
        self.away: list[Session] = []
        self.peer = SilentPeer()
        self.ada, self.bob = (self._member(player) for player in (ADA, BOB))
        self.ada.peer = self.peer  # type: ignore[assignment]
        self.publisher = Publisher(
            self.episode,
            self.broadcaster,
            metrics=self.metrics,
            timers=TimerQueue(),
            bot_scheduler=BotScheduler(lambda: ThreadBotWorker(ImmediateExecutor())),
            substitute=lambda player, action: self.episode.substitute(player, action, 1.0),
            away=self.away.append,
        )
        self.publish()
        self.peer.got.clear()

    def _member(self, player: str) -> Session:
        session = Session(f"s-{player}", name=player, kind="human", role=Role.PLAYER)
        session.players = (player,)
        self.broadcaster.members.append(session)
        return session

    def publish(self) -> list[Event]:
        events = self.episode.events()
        for event in events:
            self.publisher.publish(event)
        self.publisher.follow_up()
        return events


def in_loop(check: Callable[[], None]) -> None:
    async def main() -> None:
        check()

    run(main())


def test_steps_are_sent_and_counted_by_what_became_of_them() -> None:
    def check() -> None:
        room = Room()
        action = room.episode.state.actions(ADA)[0]
        room.episode.submit(ADA, 1, action, 0.0)
        room.episode.submit(BOB, 1, None, 0.0)
        room.publish()
        assert room.peer.kinds() == ["delta"]
        metrics = room.metrics
        assert (metrics.steps, metrics.applied, metrics.rejected) == (1, 1, 0)

    in_loop(check)


def test_an_end_is_sent_and_counted() -> None:
    def check() -> None:
        room = Room()
        room.episode.abort(1.0, "the test is over")
        room.publish()
        assert room.peer.kinds()[-1] == "ended"
        assert 'robotouille_outcomes_total{reason="aborted"} 1.0' in room.metrics.page().decode()

    in_loop(check)


def test_who_was_away_too_long_has_lost_the_seat_and_who_is_here_has_not() -> None:
    def check() -> None:
        room = Room(grace=1.0)
        room.episode.set_present(BOB, False, 1.0)
        room.publish()
        assert room.away == []
        room.episode.tick(60.0)
        room.publish()
        assert room.away == [room.bob]
        assert set(room.peer.kinds()) == {"roster"}

    in_loop(check)


def test_substitute_bots_decide_after_what_they_have_seen_is_published() -> None:
    async def main() -> None:
        room = Room(absence=Absence.BOT)
        room.episode.set_present(BOB, False, 1.0)
        room.publish()
        assert room.episode.seat(BOB).controller is Controller.STAND_IN
        await asyncio.sleep(1)
        room.episode.submit(ADA, 1, None, 2.0)
        room.publish()
        assert room.episode.step == 1
        room.publisher.stop()
        await asyncio.sleep(1)
        assert room.episode.seat(BOB).pending is None

    run(main())
