"""Activities of seats, and their counts."""

from __future__ import annotations

import pytest

from robotouille.episode import (
    Absence,
    ActionRequest,
    Activity,
    Clock,
    Controller,
    Episode,
    Outcome,
    Rules,
    SeatTally,
)
from robotouille.episode.tallies import activity
from tests.support.episodes import TWO

ADA, BOB = TWO.players
WALK = TWO.initial.actions(ADA)[0]


def judged(controller: Controller = Controller.HUMAN, **message: bool | None) -> Activity:
    facts = {"applied": None, "busy": False, "refused": False, "others_turn": False, **message}
    return activity(controller, **facts)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("controller", "message", "expected"),
    [
        (Controller.SUBSTITUTE, {"applied": True}, Activity.SUBSTITUTED),
        (Controller.SUBSTITUTE, {"busy": True}, Activity.SUBSTITUTED),
        (Controller.ABSENT, {"applied": True}, Activity.AWAY),
        (Controller.FREE, {"busy": True}, Activity.AWAY),
        (Controller.HUMAN, {"applied": True, "refused": True}, Activity.ACTED),
        (Controller.BOT, {"busy": True, "refused": True}, Activity.BUSY),
        (Controller.BOT, {"busy": True, "others_turn": True}, Activity.BUSY),
        (Controller.MODEL, {"refused": True}, Activity.WAITING),
        (Controller.MODEL, {"others_turn": True}, Activity.WAITING),
        (Controller.MODEL, {"applied": False}, Activity.WAITING),
        (Controller.HUMAN, {}, Activity.IDLE),
    ],
)
def test_first_applicable_activity_counts(
    controller: Controller, message: dict[str, bool | None], expected: Activity
) -> None:
    assert judged(controller, **message) is expected


def played(rules: Rules) -> Episode:
    episode = Episode(TWO, rules)
    for player in TWO.players:
        episode.join(player, player.upper(), "human", 0.0)
    return episode


def outcome(episode: Episode) -> dict[str, SeatTally]:
    episode.abort(1000.0, "enough")
    assert episode.outcome is not None
    assert Outcome.from_json(episode.outcome.to_json()) == episode.outcome
    return {tally.player: tally for tally in episode.outcome.seats}


def test_substitutes_steps_are_counted_separately() -> None:
    episode = played(Rules(clock=Clock.REALTIME, step_rate=1.0, absence=Absence.BOT, max_steps=99))
    episode.submit(ADA, ActionRequest(1, WALK), 0.5)
    episode.tick(1.0)
    episode.set_present(ADA, False, 1.0)
    taken = episode.state.actions(ADA)[0]
    for step in (2.0, 3.0):
        episode.substitute(ADA, taken, step - 0.5)
        episode.substitute(BOB, None, step - 0.5)
        episode.tick(step)
    episode.set_present(ADA, True, 3.2)
    episode.tick(4.0)
    ada, bob = outcome(episode).values()
    assert (ada.acted, ada.substituted, ada.rejected, ada.steps) == (1, 2, 0, 4)
    assert (bob.idle, bob.steps) == (4, 4)


def test_other_seat_waits_for_its_turn() -> None:
    episode = played(Rules(clock=Clock.TURN, max_steps=99))
    for seq in (1, 2, 3):
        player = episode.on_turn
        assert player is not None
        episode.submit(player, ActionRequest(seq), float(seq))
    ada, bob = outcome(episode).values()
    assert (ada.idle, ada.waiting, ada.steps) == (2, 1, 3)
    assert (bob.idle, bob.waiting, bob.steps) == (1, 2, 3)


def test_rejected_request_makes_one_step_a_waiting_one() -> None:
    episode = played(Rules(clock=Clock.REALTIME, step_rate=1.0, absence=Absence.WAIT, max_steps=99))
    episode.submit(ADA, ActionRequest(1, "juggle"), 0.5)
    episode.submit(ADA, ActionRequest(2, "juggle"), 0.6)
    episode.submit(BOB, ActionRequest(1, episode.state.actions(BOB)[0]), 0.5)
    episode.submit(BOB, ActionRequest(2), 0.6)  # Replaced by nothing: nobody has stood in its way.
    episode.tick(1.0)
    episode.tick(2.0)
    episode.set_present(BOB, False, 2.5)
    episode.tick(3.0)
    ada, bob = outcome(episode).values()
    assert (ada.waiting, ada.idle, ada.rejected, ada.steps) == (1, 2, 2, 3)
    assert (bob.waiting, bob.idle, bob.away, bob.rejected, bob.steps) == (0, 2, 1, 1, 3)
