"""A dish that nobody ordered, or that has a fault, stays on the hatch: the window says why."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robotouille import State, World
from robotouille.domain.rendering import language_of
from robotouille.world.presentation.unserved import unserved
from robotouille.world.presentation.wording import Wording
from robotouille.world.scene import scene
from robotouille_client.window.input.controls import Controls
from robotouille_client.window.input.hints import tips_about
from robotouille_client.window.sources.blockages import Blockages, TakenStep
from robotouille_client.window.sources.feedback import ChatLog, Feedback
from robotouille_client.window.view import View
from tests.support.shifts import file_of

ME, HATCH = "robot1", "hatch1"


def kitchen(folder: Path, *dishes: str) -> World:
    """Return the example with an order for each dish."""
    path = folder / "shift.json"
    orders = [{"at": 0, "dish": dish} for dish in dishes]
    path.write_text(json.dumps(file_of(arrivals=orders)))
    return World(f"{path}@1")


def do(state: State, *names: str, about: str = "") -> State:
    """Take the first valid action of one of some names."""
    actions = [a for a in state.actions(ME) if a.name in names]
    return state.step(next(a for a in actions if not about or about in a.arguments)).state


def walk(state: State, station: str) -> State:
    at_it = scene(state)[ME].at == station
    return state if at_it else state.step(
        next(a for a in state.actions(ME) if a.destination == station)
    ).state  # fmt: skip


def bring(state: State, *things: str) -> State:
    """Bring things of some kinds to the hatch; those that begin with `cut` are cut first."""
    for kind in (thing.removeprefix("cut ") for thing in things):
        placed = scene(state).values()
        supply = [p for p in placed if p.thing.kind == kind and p.host != HATCH]
        uppermost = max(supply, key=lambda each: each.level)
        state = do(walk(state, uppermost.host or ""), "pick-up-item", "unstack")
        if f"cut {kind}" in things:
            state = do(walk(state, "board1"), "place-item")
            for _ in range(3):
                state = do(state, "cut")
            state = do(state, "pick-up-item")
        state = do(walk(state, HATCH), "place-item", "stack")
    return state


def wording(state: State) -> Wording:
    return Wording(state.world, language_of(state.world.task), ME)


@pytest.mark.parametrize(
    ("order", "things", "expected"),
    [
        ("cheese sandwich", ("bread", "cut lettuce", "bread"), ("lettuce sandwich", "")),
        (
            "lettuce sandwich",
            ("bread", "lettuce", "bread"),
            ("lettuce sandwich", "cut the lettuce first, at the board"),
        ),
        (
            "cheese sandwich",
            ("bread", "bread"),
            ("cheese sandwich", "the cheese does not lie on the bread"),
        ),
        (
            "cheese sandwich",
            ("bread", "cheese", "cut lettuce", "bread"),
            ("cheese sandwich", "the bread does not lie on the cheese"),
        ),
    ],
)
def test_a_dish_that_fits_no_order_has_a_reason(
    tmp_path: Path, order: str, things: tuple[str, ...], expected: tuple[str, str]
) -> None:
    state = bring(kitchen(tmp_path, order).initial, *things)
    (found,) = unserved(state, wording(state))
    assert (found.station, found.dish, found.fault) == (HATCH, *expected)
    assert len(found.things) == len(things)


@pytest.mark.parametrize("things", [(), ("bread",), ("bread", "cheese")])
def test_an_unfinished_dish_needs_no_reason(tmp_path: Path, things: tuple[str, ...]) -> None:
    state = bring(kitchen(tmp_path, "cheese sandwich").initial, *things)
    assert unserved(state, wording(state)) == ()
    served = bring(state, *("bread", "cheese", "bread")[len(things) :])
    assert served.orders is not None
    assert served.orders.served == 1
    assert unserved(served, wording(served)) == ()


def test_the_window_says_once_why_a_dish_is_not_served(tmp_path: Path) -> None:
    before = bring(kitchen(tmp_path, "cheese sandwich").initial, "bread", "cut lettuce")
    now = [0.0]
    chat = ChatLog(lambda: now[0])
    feedback = Feedback(chat, Blockages(lambda: now[0]))
    feedback.stepped(TakenStep(before, before), wording(before))
    assert chat.notice == ""
    state = bring(before, "bread")
    feedback.stepped(TakenStep(before, state), wording(state))
    assert chat.notice.startswith("Nobody has ordered this now: lettuce sandwich.")
    assert chat.lines == ()
    now[0] = 60.0
    feedback.stepped(TakenStep(state, state.step([]).state), wording(state))
    assert chat.notice == "", "it is not repeated in every step"
    told = tips_about(Controls(state.world), View(state.world, state, me=ME), HATCH)
    assert told[-1].startswith("Nobody has ordered this now: lettuce sandwich.")


def test_the_reason_ends_when_the_dish_is_taken_apart(tmp_path: Path) -> None:
    before = bring(kitchen(tmp_path, "cheese sandwich").initial, "bread", "cut lettuce")
    chat = ChatLog(lambda: 0.0)
    feedback = Feedback(chat, Blockages(lambda: 0.0))
    state = bring(before, "bread")
    feedback.stepped(TakenStep(before, state), wording(state))
    assert chat.notice
    feedback.stepped(TakenStep(state, do(state, "unstack")), wording(state))
    assert chat.notice == ""
    chat.announced("Lunch is over.")
    feedback.stepped(TakenStep(state, do(state, "unstack")), wording(state))
    assert chat.notice == "Lunch is over.", "other notices stay"
