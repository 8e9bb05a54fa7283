"""Snapshots: what is the same for all is encoded once a step, and each gets its own fields."""

from __future__ import annotations

from typing import Any

import msgpack
import pytest

from robotouille import World
from robotouille.episode import Clock, Episode, Rules
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.states import StateWriter
from robotouille_server.rooms.broadcast.snapshots import Snapshots, last_seq, own_answers
from robotouille_server.transport import frame_of

WORLD = World("synchronous/01_cheese_sandwich")


@pytest.fixture
def episode() -> Episode:
    episode = Episode(WORLD, Rules(clock=Clock.LOCKSTEP), 0.0)
    episode.join(None, "Ada", "human", 0.0)
    return episode


@pytest.fixture
def snapshots(episode: Episode) -> Snapshots:
    return Snapshots("e-1", episode, StateWriter(WORLD))


def fields(frame: bytes) -> dict[str, Any]:
    """The message in a frame of MessagePack."""
    size = 126 if frame[1] < 126 else 65536 if frame[1] == 126 else 0
    start = {126: 2, 65536: 4, 0: 10}[size]
    plain: dict[str, Any] = msgpack.unpackb(frame[start:], strict_map_key=False)
    assert frame == frame_of(frame[start:])
    return plain


def test_a_snapshot_has_the_state_and_the_fields_of_who_gets_it(snapshots: Snapshots) -> None:
    plain = fields(snapshots.frame(MSGPACK, {"seat": "robot1"}, with_task=False))
    assert (plain["type"], plain["episode"], plain["step"]) == ("snapshot", "e-1", 0)
    assert plain["seat"] == "robot1"
    assert "task" not in plain


def test_the_task_comes_with_it_where_it_is_not_known(snapshots: Snapshots) -> None:
    plain = fields(snapshots.frame(MSGPACK, {}, with_task=True))
    assert plain["task"] == WORLD.task.json
    assert plain["digest"] == WORLD.task.digest


@pytest.mark.parametrize("codec", [MSGPACK, JSON], ids=repr)
def test_the_state_is_written_once_a_step_and_anew_for_the_next(
    snapshots: Snapshots, episode: Episode, codec: Codec, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[int] = []
    values = StateWriter.values

    def counted(writer: StateWriter, state: Any) -> Any:
        written.append(episode.step)
        return values(writer, state)

    monkeypatch.setattr(StateWriter, "values", counted)
    for _ in range(3):
        snapshots.frame(codec, {}, with_task=False)
    assert written == [0]
    episode.submit(WORLD.players[0], 1, episode.state.actions(WORLD.players[0])[0], 1.0)
    episode.tick(2.0)
    for _ in range(3):
        snapshots.frame(codec, {}, with_task=False)
    assert written == [0, 1]


def test_each_of_ones_seats_is_told_what_became_of_its_last_action() -> None:
    world = World("training/03_multi_agent@3")
    episode = Episode(world, Rules(clock=Clock.LOCKSTEP), 0.0)
    episode.join_several(world.players, "Ada", "model", 0.0)
    for seq, player in enumerate(world.players, 1):
        episode.submit(player, seq, None, 0.0)
    episode.submit("robot3", 8, "Boil the sea", 0.0)
    own = own_answers(episode, ("robot1", "robot3"))
    assert (own["seat"], own["seq"], own["last_seq"], own["last_step"]) == ("robot1", 8, 1, 1)
    (answer,) = own["answers"]
    assert (answer["seat"], answer["seq"], answer["step"]) == ("robot3", 8, 1)
    assert answer["reasons"]
    assert last_seq(episode, ("robot2",)) == 2
    assert own_answers(episode, ())["seat"] is None
    assert not any(own_answers(episode, ()).values())
