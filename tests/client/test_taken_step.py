"""Reading the actions of a delta."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille import World
from robotouille.episode.lifecycle import Controller
from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille_client.sansio.game_events import TakenStep

WORLD = World("multi_agent/02")
ONE, OTHER = WORLD.players
MOVE, *_ = [action for action in WORLD.initial.actions(ONE) if action.name == "move"]
OTHER_MOVE, *_ = [action for action in WORLD.initial.actions(OTHER) if action.name == "move"]
WHY = messages.Why(kind="precondition", predicate="empty", objects=["table1"])


def taken(**told: Any) -> TakenStep:
    return TakenStep.of(messages.Delta(step=1, **told), WORLD)


def both(**told: Any) -> TakenStep:
    rows = [[1, OTHER_MOVE.name, *OTHER_MOVE.arguments], [0, MOVE.name, *MOVE.arguments]]
    return taken(did=rows, seq=[7, 3], **told)


def test_rejected_action_has_its_reasons() -> None:
    step = both(unmet={"1": ["table1 is taken"]}, why={"1": [WHY]})
    assert step.did == ((OTHER, OTHER_MOVE, True), (ONE, MOVE, False))
    seq, (unmet,) = step.decided[ONE]
    assert (seq, unmet.words, unmet.predicate) == (3, "table1 is taken", "empty")


@pytest.mark.parametrize(
    "told",
    [
        {"did": [[9, MOVE.name, *MOVE.arguments]], "seq": [1]},
        {"did": [[-1, MOVE.name, *MOVE.arguments]], "seq": [1]},
        {"did": [[0, MOVE.name, *MOVE.arguments]] * 3, "seq": [1, 2, 3]},
        {"waits": [-1]},
        {"waits": [0] * 3},
        {"did": [["robot1", MOVE.name]], "seq": [1]},
        {"did": [[0, "fly", "robot1"]], "seq": [1]},
        {"did": [[0, MOVE.name, *MOVE.arguments]], "seq": []},
        {"waits": [2]},
    ],
)
def test_inconsistent_delta_is_an_error(told: dict[str, Any]) -> None:
    with pytest.raises(RobotouilleError):
        taken(**told)


def test_step_is_added_to_the_roster_unless_a_substitute_acted() -> None:
    def seats(controller: Controller) -> tuple[messages.SeatInfo, ...]:
        here = {"name": "ada", "acted": 4, "rejected": 2}
        return (
            messages.SeatInfo(player=ONE, controller=Controller.HUMAN, **here),
            messages.SeatInfo(player=OTHER, controller=controller, **here),
        )

    step = both(unmet={"1": ["no"]})
    one, other = step.tallied(seats(Controller.BOT))
    assert [(seat.acted, seat.rejected) for seat in (one, other)] == [(4, 3), (5, 2)]
    for controller in (Controller.ABSENT, Controller.SUBSTITUTE):
        assert step.tallied(seats(controller))[1].acted == 4
