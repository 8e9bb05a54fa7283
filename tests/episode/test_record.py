"""Chat, moderation, events and turns of an episode."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError
from robotouille.episode import AnnouncementMade, ChatPosted, Moderated, Moderation
from tests.support.episodes import start


def test_chat_is_numbered_and_counted_for_its_seat() -> None:
    episode = start()
    episode.say("ada", "robot1", "I take the patty", 1.0)
    episode.say("eve", "", "well done", 2.0)
    said = [e for e in episode.events() if isinstance(e, ChatPosted)]
    assert [(e.number, e.player, e.text) for e in said] == [
        (1, "robot1", "I take the patty"),
        (2, "", "well done"),
    ]
    assert (episode.record.said, episode.seat("robot1").tally.said) == (2, 1)


def test_nothing_is_reported_after_the_end() -> None:
    episode = start()
    episode.announce("hello", 0.5)
    assert episode.events() == [AnnouncementMade("hello", 0.5)]
    episode.abort(1.0, "enough")
    assert len(episode.events()) == 1
    with pytest.raises(ProtocolError) as refused:
        episode.say("ada", "robot1", "wait", 2.0)
    assert refused.value.code == "episode/ended"
    episode.announce("thank you", 2.0)
    episode.moderate(Moderation.MUTED, "s", "p", "ada", 2.0)
    assert episode.events() == []
    assert episode.record.muted == {"p"}, "still muted in later games"


def test_ban_covers_session_and_participant() -> None:
    episode = start()
    episode.moderate(Moderation.BANNED, "s", "p", "ada", 1.0)
    episode.moderate(Moderation.BANNED, "t", "", "eve", 1.0)
    assert episode.record.banned == {"s", "p", "t"}
    assert [e.what for e in episode.events() if isinstance(e, Moderated)] == ["banned"] * 2


def test_muted_participant_can_be_unmuted() -> None:
    episode = start()
    episode.moderate(Moderation.MUTED, "s", "p", "ada", 1.0)
    episode.moderate(Moderation.MUTED, "t", "", "eve", 1.0)
    assert episode.record.muted == {"p", "t"}
    episode.moderate(Moderation.UNMUTED, "other", "p", "ada", 2.0)
    assert episode.record.muted == {"t"}
