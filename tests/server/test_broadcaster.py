"""What a broadcaster sends to whom: the same to all who see alike, in their own encoding."""

from __future__ import annotations

import pytest

from robotouille import World
from robotouille.episode import Clock, Episode, Rules, Said, Stepped
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK
from robotouille.protocol.states import StateWriter
from robotouille_server.auth import Role
from robotouille_server.rooms.broadcast.broadcaster import (
    KEPT_DELTAS,
    MAX_SPECTATOR_NAMES,
    Broadcaster,
)
from robotouille_server.rooms.session import Session
from robotouille_server.runtime.metrics import Metrics
from tests.support.peers import SilentPeer

WORLD = World("synchronous/01_cheese_sandwich")
(PLAYER,) = WORLD.players


class Room:
    """An episode of one player, and those to whom it is sent."""

    def __init__(self) -> None:
        self.episode = Episode(WORLD, Rules(clock=Clock.LOCKSTEP), 0.0)
        self.episode.join(PLAYER, "Ada", "human", 0.0)
        self.episode.events()
        self.broadcaster = Broadcaster(
            "e-1", "AAAAA-BBBBB", self.episode, StateWriter(WORLD), Metrics(), lambda: 0.0
        )

    def member(self, name: str, peer: SilentPeer | None = None, view: str = "state") -> SilentPeer:
        session = Session(f"s-{name}", name=name, kind="human", role=Role.PLAYER)
        session.players = (PLAYER,) if name == "Ada" else ()
        session.view = view
        session.peer = found = peer or SilentPeer()  # type: ignore[assignment]
        self.broadcaster.members.append(session)
        assert isinstance(found, SilentPeer)
        return found

    def session(self, name: str) -> Session:
        return next(s for s in self.broadcaster.members if s.name == name)

    def step(self) -> Stepped:
        """Take a step and publish it."""
        episode = self.episode
        action = episode.state.actions(PLAYER)[0]
        episode.submit(PLAYER, episode.seat(PLAYER).seq + 1, action, 0.0)
        (stepped,) = [event for event in episode.events() if isinstance(event, Stepped)]
        self.broadcaster.publish_step(stepped)
        return stepped


@pytest.fixture
def room() -> Room:
    return Room()


def test_a_delta_is_the_same_for_all_in_each_encoding(room: Room) -> None:
    packed, text = room.member("Ada"), room.member("Bob", SilentPeer(JSON))
    room.step()
    assert packed.kinds() == text.kinds() == ["delta"]
    assert packed.got[0]["step"] == text.got[0]["step"] == 1
    assert packed.got[0]["did"] == text.got[0]["did"]


def test_who_is_behind_gets_no_deltas_and_a_snapshot_once_it_has_caught_up(room: Room) -> None:
    slow, quick = room.member("Ada"), room.member("Bob")
    slow.slow = True
    room.step()
    assert (slow.kinds(), quick.kinds()) == ([], ["delta"])
    slow.slow = False
    assert slow.catch_up is not None
    slow.catch_up()
    assert slow.kinds() == ["snapshot"]


def test_whoever_sees_words_is_sent_words(room: Room) -> None:
    reader = room.member("Ada", view="text")
    stepped = room.step()
    assert reader.kinds() == ["observation"]
    assert reader.got[0]["text"] == stepped.state.text_view(PLAYER)
    assert reader.got[0]["actions"]


def test_who_comes_back_gets_the_deltas_and_the_chat_that_were_missed(room: Room) -> None:
    peer = room.member("Ada")
    for _ in range(3):
        room.step()
    room.broadcaster.publish_said(Said("Ada", PLAYER, "hello", 0.0, 1))
    peer.got.clear()
    seen = messages.Seen(episode="e-1", step=1, said=0)
    room.broadcaster.welcome_back(room.session("Ada"), seen, "token")
    assert peer.kinds() == ["joined", "delta", "delta", "said", "roster"]
    assert [message["step"] for message in peer.got[1:3]] == [2, 3]


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
def test_otherwise_a_snapshot(room: Room, seen: messages.Seen | None) -> None:
    peer = room.member("Ada")
    room.step()
    peer.got.clear()
    room.broadcaster.welcome_back(room.session("Ada"), seen, "token")
    assert peer.kinds()[:2] == ["joined", "snapshot"]


def test_so_many_deltas_are_kept(room: Room) -> None:
    peer = room.member("Ada")
    for _ in range(KEPT_DELTAS + 1):
        room.step()
    peer.got.clear()
    seen = messages.Seen(episode="e-1", step=0, said=0)
    room.broadcaster.welcome_back(room.session("Ada"), seen, "token")
    assert peer.kinds()[:2] == ["joined", "snapshot"]


def test_spectators_who_are_away_do_not_count(room: Room) -> None:
    room.member("Ada")
    room.member("Bob")
    assert room.broadcaster.spectators == 1
    room.session("Bob").peer = None
    assert room.broadcaster.spectators == 0
    assert room.broadcaster.holder(PLAYER) is room.session("Ada")


def test_the_first_spectators_are_named_and_the_rest_counted(room: Room) -> None:
    room.member("Ada")
    names = [f"eva {i}" for i in range(MAX_SPECTATOR_NAMES + 2)]
    for name in names:
        room.member(name)
    room.session(names[0]).peer = None
    there = names[1:]
    peer = room.member("Zoe")
    room.broadcaster.publish_roster()
    room.broadcaster.send_snapshot(room.session("Zoe"))
    for message in peer.got:
        assert message["spectators"] == len(there) + 1
        assert message["spectator_names"] == there[:MAX_SPECTATOR_NAMES]


def test_chat_goes_to_everybody_in_their_encoding(room: Room) -> None:
    peers = [room.member("Ada"), room.member("Bob", SilentPeer(JSON))]
    room.broadcaster.publish_said(Said("Ada", PLAYER, "grüß dich", 0.0, 1))
    assert [peer.got[0]["text"] for peer in peers] == 2 * ["grüß dich"]
    assert {peer.codec for peer in peers} == {MSGPACK, JSON}


class TestWhatCannotBeWritten:
    """A recording begins to fail: all know that the game stands still, and nothing more."""

    def test_is_told_with_what_was_told_last(self, room: Room) -> None:
        peer = room.member("Ada")
        room.broadcaster.publish_roster()
        room.step()
        room.episode.set_present((PLAYER,), False, 0.0)
        room.episode.abort(0.0, "nobody")
        room.broadcaster.publish_unwritable()
        before, _, told = peer.got
        assert (told["phase"], told["pause"]) == ("paused", {"reason": "storage"})
        assert told["seats"] == before["seats"]

    def test_is_not_told_to_those_who_know_nothing_yet(self, room: Room) -> None:
        peer = room.member("Ada")
        room.broadcaster.publish_unwritable()
        assert peer.got == []

    def test_tells_whose_turn_it_was(self) -> None:
        world = World("multi_agent/01")
        episode = Episode(world, Rules(clock=Clock.TURN), 0.0)
        for player in world.players:
            episode.join(player, player, "human", 0.0)
        episode.events()
        room = Room()
        room.episode = episode
        room.broadcaster = Broadcaster(
            "e-1", "AAAAA-BBBBB", episode, StateWriter(world), Metrics(), lambda: 0.0
        )
        peer = room.member("eve")
        room.broadcaster.publish_roster()
        episode.submit(world.players[0], 1, None, 0.0)
        (stepped,) = [event for event in episode.events() if isinstance(event, Stepped)]
        room.broadcaster.publish_step(stepped)
        episode.submit(world.players[1], 1, None, 0.0)
        room.broadcaster.publish_unwritable()
        assert [message["turn"] for message in peer.got] == ["robot1", "robot2", "robot2"]
