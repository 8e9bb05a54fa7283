"""The card of a game that is over: what it offers is in sight, what it tells can be read."""

from __future__ import annotations

import pygame
import pytest

from robotouille import World, load_task
from robotouille.certification import step_limit
from robotouille.domain.task import Task
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import text_size
from robotouille_client.window.hands.commands import Command
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import BAD
from robotouille_client.window.shell.end_card import best_words, end_card
from robotouille_client.window.shell.game_cards import LEAVE_BUTTONS, REVIEW_BUTTONS
from robotouille_client.window.view import SeatView, View

BUTTONS = (("Play again", "again"), ("Next task", "next"), *REVIEW_BUTTONS, *LEAVE_BUTTONS)
SAVED = "The video is saved: ~/.local/share/robotouille/recordings/20261122T210000Z_10_1234.mp4"


def card(seats: int) -> Form:
    world = World(load_task("multi_agent/10", seats=seats, timing="people"))
    row = {"acted": 120, "busy": 300, "waiting": 12, "idle": 40, "away": 3, "substituted": 7}
    outcome = {
        "reason": "step_limit",
        "steps": 482,
        "seats": [{"player": player, **row} for player in world.players],
    }
    names = tuple(SeatView(player, f"Benedikta the {player}") for player in world.players)
    return end_card(View(world, world.initial, seats=names, me=world.players[0]), outcome, BUTTONS)


def panel(size: tuple[int, int]) -> tuple[pygame.Rect, int]:
    """Beside the kitchen."""
    found = layout(size, 10, 9)
    return found.panel, max(11, found.text - 2)


def screen(size: tuple[int, int]) -> tuple[pygame.Rect, int]:
    """In an otherwise empty window."""
    letters = text_size(size, 1.0)
    area = pygame.Rect(0, 0, min(size[0] - letters, 40 * letters), size[1] - 5 * letters)
    area.midbottom = (size[0] // 2, size[1] - letters)
    return area, letters


@pytest.mark.parametrize("place", [panel, screen])
@pytest.mark.parametrize("size", [(1120, 630), (640, 480), (1280, 720), (3840, 2160)])
@pytest.mark.parametrize("seats", [2, 3, 4])
@pytest.mark.parametrize("message", ["", SAVED])
def test_all_that_it_offers_is_in_sight(place, size, seats: int, message: str) -> None:  # type: ignore[no-untyped-def]
    form = card(seats)
    form.message = message
    area, letters = place(size)
    form.draw(pygame.Surface(size), area, Typesetter(), letters)
    for row in form.rows:
        place = form.place_of(row)
        assert place is not None, row.label
        assert area.contains(place), row.label
    assert not form.scroll_bar.width, "nothing has to be scrolled to"


@pytest.mark.parametrize("timing", ["people", "benchmark"])
def test_how_many_steps_it_takes_is_told_of_a_task_that_a_server_has_sent(
    monkeypatch: pytest.MonkeyPatch, timing: str
) -> None:
    """Which has no file of its own, nor has this process seen it before."""
    task = load_task("synchronous/01", timing=timing)
    sent = Task.from_json(task.to_json())
    monkeypatch.setattr(step_limit, "_lengths", {})
    words = best_words(sent)
    assert words.startswith({"people": "A very good game", "benchmark": "Proven best"}[timing])
    monkeypatch.setattr(step_limit, "_lengths", {})
    assert words == best_words(task)


def test_in_a_tiny_window_a_mark_shows_that_there_is_more() -> None:
    form = card(4)
    area, letters = panel((320, 240))
    for _ in BUTTONS:
        form.draw(pygame.Surface((320, 240)), area, Typesetter(), letters)
        assert form.scroll_bar.width
        assert form.focused is not None
        place = form.place_of(form.focused)
        assert place is not None
        assert area.contains(place)
        form.command(Command.DOWN)


def test_what_it_tells_is_not_in_the_colour_of_losing() -> None:
    form = card(2)
    form.rows = ()
    form.title = ""
    form.message = SAVED
    surface = pygame.Surface((640, 480))
    form.draw(surface, pygame.Rect(0, 0, 640, 480), Typesetter(), 14)
    assert pygame.mask.from_threshold(surface, BAD, (1, 1, 1, 255)).count() == 0
