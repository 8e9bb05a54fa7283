"""Quotas of recorded text."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError, World
from robotouille.episode import (
    ActionRejected,
    ActionRequest,
    ChatPosted,
    Clock,
    Episode,
    QuotaReached,
    Rules,
    Stepped,
    quota,
)
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from robotouille.world.grounding.actions import GroundAction

WORLD = World("multi_agent/01")
RULES = Rules(clock=Clock.REALTIME, step_rate=10.0)


def start(limit: int = 1000) -> Episode:
    episode = Episode(WORLD, RULES, 0.0)
    for player in WORLD.players:
        episode.join(player, player.upper(), "model", 0.0)
        episode.seat(player).quota.limit = limit
    episode.record.audience_quota.limit = limit
    episode.events()
    return episode


def wrong(episode: Episode) -> GroundAction:
    """Return an action whose preconditions do not hold."""
    tables = [f"table{number}" for number in range(1, 5)]
    moves = (WORLD.action("move", "robot1", a, b) for a in tables for b in tables if a != b)
    return next(move for move in moves if not WORLD.applicable(episode.state, move))


def test_reasoning_beyond_the_quota_is_refused_and_the_action_can_be_sent_again() -> None:
    episode = start()
    episode.submit("robot1", ActionRequest(1, reasoning="x" * 1000), 0.0)
    episode.tick(0.1)
    with pytest.raises(ProtocolError) as refused:
        episode.submit("robot1", ActionRequest(2, reasoning="y"), 0.1)
    assert refused.value.code == "rate/words"
    assert "act without" in str(refused.value)
    episode.submit("robot1", ActionRequest(2), 0.1)
    episode.submit("robot2", ActionRequest(1, reasoning="its own quota"), 0.1)
    episode.tick(0.2)
    events = episode.events()
    assert [e.player for e in events if isinstance(e, QuotaReached)] == ["robot1"]
    last = [event for event in events if isinstance(event, Stepped)][-1]
    assert last.idle == (("robot1", 2), ("robot2", 1))


def test_rejections_beyond_the_quota_are_reported_but_not_recorded() -> None:
    episode = start()
    action = wrong(episode)
    for seq in range(1, 30):
        episode.submit("robot1", ActionRequest(seq, action), 0.0)
    events = episode.events()
    rejected = [event for event in events if isinstance(event, ActionRejected)]
    assert len(rejected) == 29
    recorded = [event.recorded for event in rejected]
    assert recorded == sorted(recorded, reverse=True)
    assert 0 < sum(recorded) < 10
    assert sum(isinstance(event, QuotaReached) for event in events) == 1
    assert events.index(next(e for e in events if isinstance(e, QuotaReached))) == sum(recorded)


def test_chat_beyond_the_quota_is_refused() -> None:
    episode = start()
    for player in ("robot1", ""):
        said = 0
        with pytest.raises(ProtocolError) as refused:
            while True:
                episode.say("ADA", player, "x" * 100, 0.0)
                said += 1
        assert refused.value.code == "rate/words"
        assert said == 4
    events = episode.events()
    assert sum(isinstance(event, ChatPosted) for event in events) == 8
    assert [e.player for e in events if isinstance(e, QuotaReached)] == ["robot1", ""]


def test_new_participant_gets_a_share_of_the_seat(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(quota, "NEWCOMER_BYTES", 400)
    monkeypatch.setattr(quota, "MAX_SEAT_BYTES", 2000)
    episode, written = start(), []
    line = "x" * (200 - quota.NOTE_BYTES - len("EVE"))
    for _ in range(10):
        with pytest.raises(ProtocolError):
            while True:
                episode.say("EVE", "robot1", line, 0.0)
        written.append(episode.seat("robot1").quota.used)
        episode.leave("robot1", 0.0)
        episode.join("robot1", "EVE", "model", 0.0)
    assert written == [1000, 1400, 1800] + [2000] * 7


def test_restored_episode_has_the_used_quota() -> None:
    recorder = Recorder(WORLD)
    stream = recorder.begin(header(WORLD.task, RULES, episode="e"))
    played = Episode(WORLD, RULES, 0.0)
    for player in WORLD.players:
        played.join(player, player.upper(), "model", 0.0)
    played.submit("robot1", ActionRequest(1, reasoning="not recorded: nothing is done"), 0.0)
    played.submit("robot1", ActionRequest(2, wrong(played), reasoning="é" * 50), 0.0)
    played.say("ADA", "robot2", "hello", 0.0)
    played.say("SPY", "", "hello", 0.0)
    right = played.state.actions("robot2")[0]
    played.submit("robot2", ActionRequest(1, right, reasoning="because"), 0.0)
    played.tick(0.1)
    played.seat("robot2").quota.limit = 0
    with pytest.raises(ProtocolError):
        played.say("ADA", "robot2", "no more", 0.2)
    stream += recorder.record(played.events())
    restored = restore(Recording(stream), 10.0, 5.0).episode
    assert restored.seat("robot1").quota.used > 200
    for player in ("robot1", "robot2"):
        mine, theirs = restored.seat(player).quota, played.seat(player).quota
        lost = len("not recorded: nothing is done") if player == "robot1" else 0
        assert (mine.used, mine.reached) == (theirs.used - lost, theirs.reached)
    assert restored.record.audience_quota.used == played.record.audience_quota.used > 0
