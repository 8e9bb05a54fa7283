"""What is asked for and is no valid action is an event with its text, reasoning and reasons."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError
from robotouille.episode import Episode, QuotaReached, Rejected, RejectionKind
from robotouille.world.unmet import UnmetKind
from tests.support.episodes import ONE, TWO, first, start

BAD = "Put down cheese1 at table1 with robot1"


def rejections(episode: Episode) -> list[Rejected]:
    return [event for event in episode.events() if isinstance(event, Rejected)]


def test_a_sentence_is_an_action() -> None:
    episode = start(ONE)
    sentence = first(episode, "robot1").sentence
    episode.submit("robot1", 1, f"[{sentence.upper()}.]", 1.0)
    assert (episode.step, rejections(episode)) == (1, [])


def test_a_text_that_is_no_action_is_kept_with_its_reasoning() -> None:
    episode = start(ONE)
    episode.submit("robot1", 1, "Boil the sea.", 1.0, reasoning="it is salty")
    (event,) = rejections(episode)
    assert (event.player, event.seq, event.action) == ("robot1", 1, "Boil the sea.")
    assert (event.reasoning, event.code) == ("it is salty", "action/unknown")
    assert event.kind is RejectionKind.MALFORMED
    assert event.reasons[0].startswith("no valid action 'Boil the sea.'")
    tally = episode.seat("robot1").tally
    assert (tally.rejected, tally.invalid, tally.malformed) == (1, 0, 1)


def test_a_known_action_that_is_not_valid_says_what_is_unmet_and_what_was_sent() -> None:
    episode = start(ONE)
    episode.submit("robot1", 1, BAD, 1.0, reasoning="why not")
    episode.submit("robot1", 2, "place-item(robot1, cheese1, table1)", 1.0)
    one, two = rejections(episode)
    assert one.unmet == two.unmet
    assert one.unmet[0].kind is UnmetKind.CONDITION
    assert (one.action, one.text, one.reasoning) == (BAD, "", "why not")
    assert (two.action, two.text) == (BAD, "place-item(robot1, cheese1, table1)")
    assert one.kind is two.kind is RejectionKind.INVALID
    tally = episode.seat("robot1").tally
    assert (tally.rejected, tally.invalid, tally.malformed) == (2, 2, 0)


def test_what_is_replaced_is_neither_invalid_nor_malformed() -> None:
    episode = start()
    for seq in (1, 2):
        episode.submit("robot1", seq, first(episode, "robot1").sentence, 1.0)
    (event,) = rejections(episode)
    assert event.kind is RejectionKind.SUPERSEDED
    tally = episode.seat("robot1").tally
    assert (tally.rejected, tally.invalid, tally.malformed) == (1, 0, 0)


def test_the_same_number_again_is_counted_once() -> None:
    episode = start(ONE)
    for _ in range(2):
        episode.submit("robot1", 1, "Boil the sea", 1.0)
    episode.reject("robot1", 2, "99", ProtocolError("action/unknown", "no 99"), 1.0)
    episode.submit("robot1", 2, "Boil the sea", 1.0)
    with pytest.raises(ProtocolError, match="older than 2"):
        episode.submit("robot1", 1, "Boil the sea", 1.0)
    assert len(rejections(episode)) == 2
    assert episode.seat("robot1").answer.code == "action/unknown"
    assert episode.seat("robot1").answer.reasons == ("no 99",)


def test_a_position_of_a_step_that_is_past_is_invalid() -> None:
    episode = start(ONE)
    episode.reject("robot1", 1, "3", ProtocolError("action/stale", "step 0 is past"), 1.0)
    (event,) = rejections(episode)
    assert (event.code, event.kind) == ("action/stale", RejectionKind.INVALID)


def test_nothing_is_counted_before_the_beginning() -> None:
    episode = Episode(TWO, start().rules)
    episode.join(None, "ada", "model", 0.0)
    with pytest.raises(ProtocolError, match="waits for 1 more"):
        episode.submit("robot1", 1, "Boil the sea", 0.0)
    assert rejections(episode) == []


def test_the_quota_of_words_holds_for_it() -> None:
    episode = start(ONE)
    quota = episode.seat("robot1").quota
    quota.limit = quota.used + 250
    episode.submit("robot1", 1, "Boil the sea", 1.0, reasoning="x" * 20)
    used = quota.used
    assert used > 20 + len("Boil the sea")
    episode.submit("robot1", 2, "Boil the sea", 1.0)
    one, reached, two = episode.events()[-3:]
    assert isinstance(one, Rejected)
    assert one.recorded
    assert isinstance(reached, QuotaReached)
    assert isinstance(two, Rejected)
    assert not two.recorded
    with pytest.raises(ProtocolError, match="no more of what is written"):
        episode.submit("robot1", 3, "Boil the sea", 1.0, reasoning="x")
    assert episode.seat("robot1").tally.malformed == 2
