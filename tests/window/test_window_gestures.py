"""Movements of players and the panel between two states: joy, glances, breath, ticks, stars."""

from __future__ import annotations

from dataclasses import replace

import pygame
import pytest
from tests.support.scripted import planned
from tests.support.shifts import act, bistro, toast_almost

from robotouille import State, World, load_task
from robotouille_client.window.app.game_cards import end_card
from robotouille_client.window.drawing.kitchen.earnings import served_at
from robotouille_client.window.drawing.kitchen.gestures import CHEER_SECONDS
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import Bubble, SeatView, View

SIZE = (1280, 720)
STILL = Preferences(reduced_motion=True)


@pytest.fixture(scope="module")
def course() -> list[State]:
    return planned("asynchronous/04", 1)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> tuple[State, State, State]:
    """Return the states before, at, and after the first order that is served."""
    before = toast_almost(bistro(tmp_path_factory.mktemp("bistro")))
    now = act(before, "Stack bread2 onto plate1 at hatch1 with robot1")
    return before, now, act(now, None)


def at(states: list[State], step: int, **fields: object) -> View:
    state = states[step]
    shown = View(state.world, state, states[step - 1], step, me=state.world.players[0])
    return replace(shown, **fields)  # type: ignore[arg-type]


def picture(painter: Painter, view: View) -> bytes:
    surface = pygame.Surface(SIZE)
    painter.paint(surface, view)
    return pygame.image.tobytes(surface, "RGB")


def looks(painter: Painter, views: list[View]) -> int:
    """Return the number of different pictures, which must be those announced as different."""
    painter.paint(pygame.Surface(SIZE), views[0])
    keys = [str(painter.redraw_key(view)) for view in views]
    pictures = [picture(painter, view) for view in views]
    assert len(set(pictures)) <= len(set(keys))
    return len(set(pictures))


@pytest.mark.slow
def test_players_cheer_for_two_seconds_when_the_game_is_won(course) -> None:
    last = len(course) - 1
    ends = [at(course, last, won=True, seconds=9.0 + s, since_end=s) for s in (0.05, 0.15, 0.3)]
    assert looks(Painter(), ends) == 3
    assert looks(Painter(preferences=STILL), ends) == 1
    late = CHEER_SECONDS + 0.1
    over = at(course, last, won=True, seconds=9.0, since_end=late)
    assert picture(Painter(), over) == picture(Painter(), replace(over, since_end=late + 9.0))


def test_drops_at_the_end_of_a_lost_game_fall_and_then_vanish(course) -> None:
    shown = at(course, 1, lost=True, seconds=9.0)
    assert looks(Painter(), [replace(shown, since_end=s) for s in (0.0, 0.5, 1.0)]) == 3
    late = replace(shown, since_end=CHEER_SECONDS + 1.0)
    assert picture(Painter(), late) == picture(Painter(), replace(late, lost=False))


@pytest.mark.slow
def test_idle_players_breathe_and_blink_but_not_in_a_pause(course) -> None:
    shown = at(course, 1, previous=None)
    moments = [replace(shown, seconds=n / 12) for n in range(44)]
    assert 3 <= looks(Painter(), moments) <= 12, "few pictures cost little"
    assert looks(Painter(preferences=STILL), moments[::4]) == 1
    assert looks(Painter(), [replace(view, offline=0.0) for view in moments[::4]]) == 1


def test_teammates_look_at_who_speaks() -> None:
    world = World(load_task("multi_agent/01@2"))
    one, other = world.players
    quiet = View(world, world.initial, me=one, seconds=5.0)
    speaks = replace(quiet, bubbles=(Bubble(one, "Hello", "chat"),))
    painter = Painter()
    painter.paint(pygame.Surface(SIZE), quiet)

    def gestures(view: View) -> object:
        return painter.redraw_key(view)[1]  # type: ignore[index]

    calm, listening = gestures(quiet), gestures(speaks)
    assert listening[one].facing == calm[one].facing  # type: ignore[index]
    assert listening[other].facing != calm[other].facing  # type: ignore[index]
    assert (
        gestures(replace(speaks, seconds=8.0))[other]
        == gestures(  # type: ignore[index]
            replace(quiet, seconds=8.0)
        )[other]
    )  # type: ignore[index]


def test_a_served_dish_is_cheered_and_its_points_rise(served) -> None:
    before, now, after = served
    painter = Painter()
    shown = View(now.world, before, None, 1, seconds=1.0)
    painter.paint(pygame.Surface(SIZE), shown)
    moments = [
        replace(shown, state=now, previous=before, step=2, seconds=1.2 + n / 10) for n in range(4)
    ]
    assert looks(painter, moments) == 4
    later = replace(shown, state=after, previous=now, step=3, seconds=4.0, phase=1.0)
    assert picture(painter, later) == picture(Painter(), later)


def test_stars_are_stamped_one_by_one_and_points_are_counted() -> None:
    world = World(load_task("shifts/01_sandwich_bar@1"))
    outcome = {"reason": "shift_over", "steps": 600, "score": {"points": 9_000, "served": 9}}
    seats = (SeatView("robot1", "ada"),)
    card = end_card(View(world, world.initial, seats=seats, won=True), outcome, [("Menu", "menu")])

    def drawn(age: float) -> bytes:
        surface = pygame.Surface((300, 400))
        card.age = age
        card.draw(surface, surface.get_rect(), Typesetter(), 14)
        return pygame.image.tobytes(surface, "RGB")

    moving = [drawn(age) for age in (0.2, 0.6, 1.4, 1.9, 2.4)]
    assert len(set(moving)) == len(moving)
    assert moving[-1] == drawn(float("inf"))


def test_points_rise_from_the_station_where_a_dish_was_served(served) -> None:
    before, now, _ = served
    painter, surface = Painter(), pygame.Surface(SIZE)
    me = now.world.players[0]
    assert served_at(before, now) == "hatch1"
    painter.paint(surface, View(before.world, before, None, 1, me=me, seconds=1.0))
    view = View(now.world, now, before, 2, me=me, seconds=1.1)
    keys = set()
    for seconds in (1.1, 1.3, 1.6):
        shown = replace(view, seconds=seconds)
        painter.paint(surface, shown)
        keys.add(str(painter.redraw_key(shown)))
    assert len(keys) == 3
    place = painter.layout(SIZE, now.world)
    tile = now.world.thing("hatch1").tile
    assert tile is not None
    top = place.cell(tile).move(0, -place.tile // 2)
    after = picture_of(surface, top)
    painter.paint(surface, replace(view, seconds=9.0))
    assert picture_of(surface, top) != after, "the points vanish again"


def picture_of(surface: pygame.Surface, area: pygame.Rect) -> bytes:
    return pygame.image.tobytes(surface.subsurface(area.clip(surface.get_rect())), "RGB")
