"""The keys shown at crates, bins and hatches say what the keys do."""

from __future__ import annotations

import pygame
import pytest
from tests.support.window_play import SIZE, Script, Timer, headless_window, press, world_of

from robotouille.world.scene import scene
from robotouille_client.window.input.action_queue import GUARD_SECONDS
from robotouille_client.window.input.hints import tips_about

SHIFT = "shifts/01_sandwich_bar@1"


class Cook:
    """A person at the window of a shift."""

    def __init__(self) -> None:
        self.timer = Timer()
        self.source = Script(world_of(SHIFT))
        self.window = headless_window(SIZE, clock=self.timer)
        self.window.frame(self.source)

    def go(self, station: str) -> None:
        state, me = self.source.state, self.source.me
        if scene(state)[me].at != station:
            self.source.act(next(a for a in state.actions(me) if a.destination == station))
        self.rest()

    def use(self) -> None:
        press(self.window, self.source, pygame.K_e)

    def rest(self) -> None:
        """Let a moment pass, after which E may move the same thing again."""
        self.timer.now += GUARD_SECONDS + 0.1
        self.window.frame(self.source)

    @property
    def strip(self) -> dict[str, str]:
        return dict(self.window.overlay(self.source.view()).hints)

    @property
    def held(self) -> list[str]:
        placed = scene(self.source.state)
        return [name for name, each in placed.items() if each.host == self.source.me]


@pytest.fixture
def cook() -> Cook:
    return Cook()


def test_e_puts_nothing_on_the_supplies_of_something_else(cook: Cook) -> None:
    cook.go("crate2")
    cook.use()
    (cheese,) = cook.held
    cook.go("crate1")
    assert cook.strip == {
        "": "The cheese does not belong here", "Click": "Put the cheese on the bread",
    }  # fmt: skip
    cook.use()
    assert cook.held == [cheese]
    cook.go("crate2")
    assert cook.strip == {"E": "Put the cheese on the crate"}
    cook.use()
    assert cook.held == []


def test_a_dish_may_begin_with_two_equal_things(cook: Cook) -> None:
    for crate in ("crate1", "crate1", "crate2"):
        cook.go(crate)
        cook.use()
        cook.go("hatch1")
        cook.use()
        assert cook.held == []


def test_the_strip_offers_e_only_when_it_does_something(cook: Cook) -> None:
    cook.go("crate1")
    assert cook.strip == {"E": "Take the bread from the crate"}
    cook.use()
    assert cook.strip == {}, "a press too many does nothing"
    cook.use()
    assert len(cook.held) == 1
    cook.rest()
    assert cook.strip == {"E": "Put the bread on the crate"}


def test_the_strip_says_that_a_bin_takes_things_away(cook: Cook) -> None:
    cook.go("crate1")
    cook.use()
    cook.go("bin1")
    does = "Put down the bread, which goes back to where it came from"
    assert cook.strip == {"E": does}
    view = cook.source.view()
    assert tips_about(cook.window._input.controls(view), view, "bin1") == (does,)


def test_the_strip_says_what_a_station_is_for(cook: Cook) -> None:
    cook.go("hatch1")
    assert cook.strip == {"": "Build dishes here; a complete dish is served"}


def test_the_strip_has_no_advice_for_empty_hands_at_a_table(cook: Cook) -> None:
    cook.go("table1")
    assert cook.strip == {}
