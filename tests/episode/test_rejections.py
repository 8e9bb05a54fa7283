"""Rejected requests: text, reasoning, reasons and counts."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError
from robotouille.episode import ActionRejected, ActionRequest, Clock, Episode, RejectionKind
from robotouille.world.unmet import UnmetKind
from tests.support.episodes import ONE, first, start

BAD = "Put down cheese1 at table1 with robot1"


def rejections(episode: Episode) -> list[ActionRejected]:
    return [event for event in episode.events() if isinstance(event, ActionRejected)]


def test_sentence_names_an_action() -> None:
    episode = start(ONE)
    sentence = first(episode, "robot1").sentence
    episode.submit("robot1", ActionRequest(1, f"[{sentence.upper()}.]"), 1.0)
    assert (episode.step, rejections(episode)) == (1, [])


def test_malformed_text_is_reported_with_its_reasoning() -> None:
    episode = start(ONE)
    episode.submit("robot1", ActionRequest(1, "Boil the sea.", reasoning="it is salty"), 1.0)
    (event,) = rejections(episode)
    assert (event.player, event.seq, event.action) == ("robot1", 1, "Boil the sea.")
    assert (event.reasoning, event.code) == ("it is salty", "action/unknown")
    assert event.kind is RejectionKind.MALFORMED
    assert event.reasons[0].startswith("no valid action 'Boil the sea.'")
    tally = episode.seat("robot1").tally
    assert (tally.rejected, tally.invalid, tally.malformed) == (1, 0, 1)


def test_invalid_action_is_reported_with_unmet_conditions_and_text() -> None:
    episode = start(ONE)
    episode.submit("robot1", ActionRequest(1, BAD, reasoning="why not"), 1.0)
    episode.submit("robot1", ActionRequest(2, "place-item(robot1, cheese1, table1)"), 1.0)
    one, two = rejections(episode)
    assert one.unmet == two.unmet
    assert one.unmet[0].kind is UnmetKind.CONDITION
    assert (one.action, one.text, one.reasoning) == (BAD, "", "why not")
    assert (two.action, two.text) == (BAD, "place-item(robot1, cheese1, table1)")
    assert one.kind is two.kind is RejectionKind.INVALID
    tally = episode.seat("robot1").tally
    assert (tally.rejected, tally.invalid, tally.malformed) == (2, 2, 0)


def test_repeated_number_is_counted_once() -> None:
    episode = start(ONE)
    for _ in range(2):
        episode.submit("robot1", ActionRequest(1, "Boil the sea"), 1.0)
    episode.reject("robot1", ActionRequest(2, "99"), ProtocolError("action/unknown", "no 99"), 1.0)
    episode.submit("robot1", ActionRequest(2, "Boil the sea"), 1.0)
    with pytest.raises(ProtocolError, match="older than 2"):
        episode.submit("robot1", ActionRequest(1, "Boil the sea"), 1.0)
    assert len(rejections(episode)) == 2
    assert episode.seat("robot1").answer.code == "action/unknown"
    assert episode.seat("robot1").answer.reasons == ("no 99",)


def test_position_in_an_old_list_is_invalid() -> None:
    episode = start(ONE)
    episode.reject(
        "robot1", ActionRequest(1, "3"), ProtocolError("action/stale", "step 0 is past"), 1.0
    )
    (event,) = rejections(episode)
    assert (event.code, event.kind) == ("action/stale", RejectionKind.INVALID)


def at_step(step: int) -> Episode:
    episode = start(ONE)
    for seq in range(1, step + 1):
        episode.submit("robot1", ActionRequest(seq), 1.0)
    episode.events()
    return episode


@pytest.mark.parametrize(("max_age", "applied"), [(0, False), (1, False), (2, True), (None, True)])
def test_action_on_an_older_state_than_it_allows_is_stale(
    max_age: int | None, applied: bool
) -> None:
    episode = at_step(3)
    action = first(episode, "robot1")
    episode.submit("robot1", ActionRequest(9, action, basis=1, max_age=max_age), 1.0)
    assert episode.step == 3 + applied
    for event in rejections(episode):
        assert (event.code, event.unmet[0].kind) == ("action/stale", UnmetKind.STALE)
        assert event.reasons == (f"the action is 2 steps old, and at most {max_age} are allowed",)
        assert event.kind is RejectionKind.INVALID
    assert applied or episode.seat("robot1").answer.code == "action/stale"


@pytest.mark.parametrize("basis", [None, 7])
def test_age_needs_a_basis_that_the_game_has_reached(basis: int | None) -> None:
    episode = at_step(3)
    action = first(episode, "robot1")
    episode.submit("robot1", ActionRequest(9, action, basis=basis, max_age=5), 1.0)
    (event,) = rejections(episode)
    assert event.reasons == ("max_age needs 'basis', a step up to the current step 3",)


def test_declared_thinking_makes_an_action_older() -> None:
    episode = start(ONE, clock=Clock.REALTIME, step_rate=5, thinking="declared")
    action = first(episode, "robot1")
    episode.submit("robot1", ActionRequest(1, action, basis=0, think_ms=600, max_age=2), 1.0)
    (event,) = rejections(episode)
    assert event.reasons == ("the action is 3 steps old, and at most 2 are allowed",)


def test_unknown_action_has_a_kind_of_its_own() -> None:
    episode = start(ONE)
    episode.submit("robot1", ActionRequest(1, "Boil the sea"), 1.0)
    (event,) = rejections(episode)
    assert event.unmet[0].kind is UnmetKind.UNKNOWN
