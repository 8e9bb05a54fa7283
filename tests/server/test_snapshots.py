"""Snapshots, and messages from a room to its members."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import msgpack
import pytest
from pydantic import BaseModel

from robotouille import World
from robotouille.episode import ActionRequest, ChatPosted, Clock, Episode, Rules, Stepped
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.frames import FrameReader
from robotouille.protocol.states import StateWriter
from robotouille_server.auth import Role
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.broadcaster import (
    KEPT_DELTAS,
    MAX_SPECTATOR_NAMES,
    REPEATED_SAID,
    Broadcaster,
)
from robotouille_server.rooms.publishing.episode_messages import last_seq, own_answers
from robotouille_server.rooms.recording.write_ahead import CommitGate
from robotouille_server.runtime.timer_queue import TimerHandle, TimerQueue
from robotouille_server.transport import LoopBudget

WORLD = World("synchronous/01_cheese_sandwich")


class SilentPeer:
    """Peer that stores its messages in `got`; with `slow`, it does not keep up."""

    def __init__(self, codec: Codec = MSGPACK) -> None:
        self.codec = codec
        self.slow = False
        self.got: list[dict[str, Any]] = []
        self.catch_up: Callable[[], None] | None = None
        self.received_bytes = 0

    @property
    def behind(self) -> bool:
        return self.slow

    def keeps_up(self, catch_up: Callable[[], None]) -> bool:
        self.catch_up = catch_up
        return not self.slow

    def send(self, message: BaseModel) -> None:
        self.got.append(message.model_dump(mode="json"))

    def send_frame(self, frame: bytes, count: int = 1) -> None:
        reader = FrameReader(masked=False, max_size=2**20)
        reader.receive(frame)
        unpack = json.loads if self.codec is JSON else msgpack.unpackb
        while reader.next_frame():
            self.got.append(unpack(reader.content))

    answer = send
    answer_frame = send_frame

    def kinds(self) -> list[str]:
        """Return the types of the received messages, in order."""
        return [message["type"] for message in self.got]


@pytest.fixture
def episode() -> Episode:
    episode = Episode(WORLD, Rules(clock=Clock.LOCKSTEP), 0.0)
    episode.join(None, "Ada", "human", 0.0)
    return episode


def test_each_seat_gets_the_result_of_its_last_action() -> None:
    world = World("training/03_multi_agent@3")
    episode = Episode(world, Rules(clock=Clock.LOCKSTEP), 0.0)
    episode.join_several(world.players, "Ada", "model", 0.0)
    for seq, player in enumerate(world.players, 1):
        episode.submit(player, ActionRequest(seq), 0.0)
    episode.submit("robot3", ActionRequest(8, "Boil the sea"), 0.0)
    own = own_answers(episode, ("robot1", "robot3"))
    assert (own["seat"], own["seq"], own["last_seq"], own["last_step"]) == ("robot1", 8, 1, 1)
    (answer,) = own["answers"]
    assert (answer["seat"], answer["seq"], answer["step"]) == ("robot3", 8, 1)
    assert answer["reasons"]
    assert last_seq(episode, ("robot2",)) == 2
    assert own_answers(episode, ())["seat"] is None
    assert not any(own_answers(episode, ()).values())


(PLAYER,) = WORLD.players


class Timers(TimerQueue):
    """Timers that wait for `deliver`."""

    def __init__(self) -> None:
        self.waiting: list[Callable[[float], None]] = []

    def time(self) -> float:
        return 0.0

    def call_at(self, due: float, call: Callable[[float], None]) -> TimerHandle:
        self.waiting.append(call)
        return TimerHandle(due, call)


class Turns(LoopBudget):
    """Budget that is never used up."""

    def __init__(self) -> None:
        pass

    over = False

    def spend(self, cost: float) -> None:
        pass

    def wait(self, resume: Callable[[], None], group: object = None) -> None:
        resume()


class Room:
    """Episode with one player, and its broadcaster."""

    def __init__(self, episode: Episode | None = None) -> None:
        if episode is None:
            episode = Episode(WORLD, Rules(clock=Clock.LOCKSTEP), 0.0)
            episode.join(PLAYER, "Ada", "human", 0.0)
        self.episode = episode
        self.episode.events()
        self._timers = Timers()
        writer, gate = StateWriter(episode.world), CommitGate(None)
        self.broadcaster = Broadcaster(
            "e-1", "AAAAA-BBBBB", episode, writer, self._timers, Turns(), gate
        )

    def deliver(self) -> None:
        """Deliver what is pending to the spectators."""
        waiting, self._timers.waiting = self._timers.waiting, []
        for call in waiting:
            call(0.0)

    def member(self, name: str, peer: SilentPeer | None = None, view: str = "state") -> SilentPeer:
        session = Session(f"s-{name}", name=name, kind="human", role=Role.PLAYER)
        session.players = (PLAYER,) if name == "Ada" else ()
        session.view = view
        session.peer = found = peer or SilentPeer()  # type: ignore[assignment]
        self.broadcaster.enter(session)
        assert isinstance(found, SilentPeer)
        return found

    def session(self, name: str) -> Session:
        return next(s for s in self.broadcaster.members if s.name == name)

    def step(self) -> Stepped:
        """Take a step and publish it."""
        episode = self.episode
        action = episode.state.actions(PLAYER)[0]
        episode.submit(PLAYER, ActionRequest(episode.seat(PLAYER).seq + 1, action), 0.0)
        (stepped,) = [event for event in episode.events() if isinstance(event, Stepped)]
        self.broadcaster.publish_step(stepped)
        return stepped


@pytest.fixture
def room() -> Room:
    return Room()


@pytest.mark.parametrize(
    "seen",
    [
        None,
        messages.Seen(episode="another", step=1, said=0),
        messages.Seen(episode="e-1", step=1, said=0, stale=True),
        messages.Seen(episode="e-1", step=1000, said=0),
    ],
    ids=["nothing", "another episode", "stale", "the future"],
)
def test_returning_client_without_kept_deltas_gets_a_snapshot(
    room: Room, seen: messages.Seen | None
) -> None:
    peer = room.member("Ada")
    room.step()
    peer.got.clear()
    room.broadcaster.welcome_back(room.session("Ada"), seen, "token")
    assert peer.kinds()[:2] == ["joined", "snapshot"]


def test_participant_who_returns_in_a_new_program_gets_the_recent_chat(room: Room) -> None:
    peer = room.member("Ada")
    said = [ChatPosted("Ada", "robot1", f"line {n}", 1.0, n) for n in range(1, 31)]
    for event in said:
        room.broadcaster.publish_said(event)
    peer.got.clear()
    room.broadcaster.welcome_back(room.session("Ada"), None, "token")
    texts = [message["text"] for message in peer.got if message["type"] == "said"]
    assert texts == [event.text for event in said[-REPEATED_SAID:]]


def test_number_of_kept_deltas_is_bounded(room: Room) -> None:
    peer = room.member("Ada")
    for _ in range(KEPT_DELTAS + 1):
        room.step()
    peer.got.clear()
    seen = messages.Seen(episode="e-1", step=0, said=0)
    room.broadcaster.welcome_back(room.session("Ada"), seen, "token")
    assert peer.kinds()[:2] == ["joined", "snapshot"]


def test_only_the_first_spectators_are_named(room: Room) -> None:
    room.member("Ada")
    names = [f"eva {i}" for i in range(MAX_SPECTATOR_NAMES + 2)]
    for name in names:
        room.member(name)
    room.session(names[0]).peer = None
    there = names[1:]
    peer = room.member("Zoe")
    room.broadcaster.publish_roster()
    room.deliver()
    room.broadcaster.send_snapshot(room.session("Zoe"))
    for message in peer.got:
        assert message["spectators"] == len(there) + 1
        assert message["spectator_names"] == there[:MAX_SPECTATOR_NAMES]


class TestUnwritableRecording:
    """Rosters when a recording starts to fail: they report the pause and nothing unwritten."""

    def test_roster_has_the_last_published_turn(self) -> None:
        world = World("multi_agent/01")
        episode = Episode(world, Rules(clock=Clock.TURN), 0.0)
        for player in world.players:
            episode.join(player, player, "human", 0.0)
        episode.events()
        room = Room(episode)
        peer = room.member("Ada")
        room.broadcaster.publish_roster()
        episode.submit(world.players[0], ActionRequest(1), 0.0)
        (stepped,) = [event for event in episode.events() if isinstance(event, Stepped)]
        room.broadcaster.publish_step(stepped)
        episode.submit(world.players[1], ActionRequest(1), 0.0)
        room.broadcaster.publish_unwritable()
        assert [message["turn"] for message in peer.got] == ["robot1", "robot2", "robot2"]
