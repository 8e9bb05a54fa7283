"""What is said in an episode, what an operator decides on people, and what is reported."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError
from robotouille.episode import Announced, Clock, Moderated, Moderation, Said
from tests.support.episodes import start


def test_chat_is_numbered_and_counted_for_its_seat() -> None:
    episode = start()
    episode.say("ada", "robot1", "I take the patty", 1.0)
    episode.say("eve", "", "well done", 2.0)
    said = [e for e in episode.events() if isinstance(e, Said)]
    assert [(e.number, e.player, e.text) for e in said] == [
        (1, "robot1", "I take the patty"),
        (2, "", "well done"),
    ]
    assert (episode.said, episode.seat("robot1").tally.said) == (2, 1)


def test_after_the_end_nothing_is_said_and_nothing_recorded() -> None:
    episode = start()
    episode.abort(1.0, "enough")
    episode.events()
    with pytest.raises(ProtocolError) as refused:
        episode.say("ada", "robot1", "wait", 2.0)
    assert refused.value.code == "episode/over"
    episode.announce("thank you", 2.0)
    episode.moderate(Moderation.MUTED, "s", "p", "ada", 2.0)
    assert episode.events() == []
    assert episode.muted == {"p"}, "it is still muted for what comes"


def test_a_ban_holds_for_the_session_and_for_the_person() -> None:
    episode = start()
    episode.moderate(Moderation.BANNED, "s", "p", "ada", 1.0)
    episode.moderate(Moderation.BANNED, "t", "", "eve", 1.0)
    assert episode.banned == {"s", "p", "t"}
    assert [e.what for e in episode.events() if isinstance(e, Moderated)] == ["banned"] * 2


def test_who_was_muted_may_talk_again() -> None:
    episode = start()
    episode.moderate(Moderation.MUTED, "s", "p", "ada", 1.0)
    episode.moderate(Moderation.MUTED, "t", "", "eve", 1.0)
    assert episode.muted == {"p", "t"}
    episode.moderate(Moderation.UNMUTED, "other", "p", "ada", 2.0)
    assert episode.muted == {"t"}


def test_events_come_once_and_in_order() -> None:
    episode = start()
    episode.announce("one", 1.0)
    episode.announce("two", 2.0)
    assert episode.events() == [Announced("one", 1.0), Announced("two", 2.0)]
    assert episode.events() == []


def test_it_is_somebodys_turn_only_in_a_game_with_turns_that_is_played() -> None:
    episode = start(clock=Clock.TURN)
    assert episode.on_turn == "robot1"
    episode.abort(1.0, "enough")
    assert episode.on_turn is None
    assert start(clock=Clock.LOCKSTEP).on_turn is None
