"""Chat, moderation, outcomes and rules of an episode."""

from __future__ import annotations

import json
import random

import pytest
from pydantic import ValidationError

from robotouille import ProtocolError, World
from robotouille.episode import (
    ActionRequest,
    AnnouncementMade,
    ChatPosted,
    Clock,
    Episode,
    Moderated,
    Moderation,
    Outcome,
    Reason,
    Rules,
    SeatTally,
)
from robotouille.episode.rules import MOVE_BUDGET
from robotouille.world.sight import Seen, seen_by
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


OUTCOME = Outcome(Reason.ABANDONED, 7, 1.2345, (SeatTally("robot1", 3, 1, 2, 4),), "why")


def test_outcome_round_trips_through_json() -> None:
    row = OUTCOME.to_json()
    assert json.loads(json.dumps(row)) == row
    assert row["seconds"] == 1.234
    assert Outcome.from_json(row).to_json() == row


@pytest.mark.parametrize("reason", Reason)
def test_only_the_goal_is_a_success(reason: Reason) -> None:
    assert Outcome(reason, 1, 1.0, ()).success == (reason is Reason.GOAL)


@pytest.mark.parametrize(
    ("clock", "asked", "seats", "budget"),
    [
        (Clock.LOCKSTEP, None, 2, MOVE_BUDGET),
        (Clock.LOCKSTEP, None, 1, None),
        (Clock.REALTIME, None, 2, None),
        (Clock.TURN, 0, 2, None),
        (Clock.TURN, 7.5, 2, 7.5),
    ],
)
def test_default_move_budget_needs_several_seats(
    clock: Clock, asked: float | None, seats: int, budget: float | None
) -> None:
    assert Rules(clock=clock).with_budget(asked, seats).move_budget == budget


@pytest.mark.parametrize(
    "rules",
    [
        {"step_rate": 0.0},
        {"step_rate": 61},
        {"move_budget": 0.001},
        {"max_steps": 0},
        {"grace": -1},
        {"clock": "sundial"},
        {"weather": "rain"},
    ],
)
def test_rules_out_of_range_are_refused(rules: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Rules(**rules)  # type: ignore[arg-type]


def views(episode: Episode) -> list[tuple[Seen, Seen]]:
    """Return each player's view as the record keeps it, and a new one."""
    sight = episode.rules.limited_sight
    assert sight is not None
    return [
        (
            episode.record.seen(episode.state, (player,), sight),
            seen_by(episode.state, player, sight),
        )
        for player in episode.world.players
    ]


@pytest.mark.parametrize("task", ["multi_agent/01@3", "shifts/04"])
def test_known_views_equal_new_ones(task: str) -> None:
    world, rng = World(task), random.Random(1)
    episode = start(world, clock=Clock.REALTIME, step_rate=10, sight=2, sight_blocked=True)
    for seq in range(1, 41):
        # In most steps, nobody acts.
        for player in world.players if seq % 4 == 0 else ():
            actions = episode.offered_actions(player)
            action = rng.choice(actions) if actions else None
            episode.submit(player, ActionRequest(seq, action), seq / 10)
        episode.tick(seq / 10)
        for known, new in views(episode):
            assert (known, known.hidden, known.actions) == (new, new.hidden, new.actions)
            assert known.text_view(known.players[0]) == new.text_view(known.players[0])


def test_step_without_actions_needs_no_search_for_actions() -> None:
    """In idle games, texts of limited sight once used up the time of all others."""
    episode = start(World("shifts/04"), clock=Clock.REALTIME, step_rate=10, sight=2)
    before = [known.actions for known, _ in views(episode)]
    episode.tick(0.1)
    after = [known.actions for known, _ in views(episode)]
    assert all(one is other for one, other in zip(before, after, strict=True))
