"""Windows of any size: what is in them is as large as it can be, and nothing is cut off."""

from __future__ import annotations

from dataclasses import replace

import pygame
import pytest
from tests.support.samples import first_quickly

from robotouille import World, task_names
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.forms.widgets import Button, Choice, Words
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import PANEL
from robotouille_client.window.view import SeatView, View

SIZES = [(320, 240), (480, 270), (640, 360), (1280, 720), (1920, 1080), (2560, 1080), (600, 900)]
WORDS = "Wohlgeschmack" * 12


def crowded(world: World) -> View:
    names = ("Ada", "W" * 40, "厨房の田中さん", "e\u0301" * 30)
    seats = tuple(
        SeatView(player, name, actions=1234, rejected=99)
        for player, name in zip(world.players, names, strict=False)
    )
    return View(
        world, world.initial, None, 12_345, 99_999, "real time", 1.0, seats, world.players[0],
        chat=((names[1], WORDS), ("Ada", "Hello."), ("", WORDS)), status=WORDS,
        code="RNYHV-KDQTA", watching=3, step_seconds=0.2, spectator_names=names[1:],
    )  # fmt: skip


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("task", ["multi_agent/10@4", "asynchronous/10", "workshop/02"])
@pytest.mark.parametrize("waiting", [False, True])
def test_nothing_in_the_panel_is_cut_off(size: tuple[int, int], task: str, waiting: bool) -> None:
    world = World(task)
    painter, surface = Painter(), pygame.Surface(size)
    view = replace(crowded(world), waits_for=world.players[::-1] if waiting else ())
    painter.paint(surface, view)
    place = painter.layout(size, world)
    panel, margin = place.panel, place.text // 2
    for edge in (
        pygame.Rect(panel.left + 2, 0, margin - 2, panel.height),
        pygame.Rect(panel.right - margin, 0, margin, panel.height),
        pygame.Rect(panel.left + 2, panel.bottom - margin, panel.width - 2, margin),
    ):
        found = pygame.transform.average_color(surface, edge)[:3]
        assert all(abs(a - b) <= 1 for a, b in zip(found, PANEL, strict=True)), edge


@pytest.mark.parametrize("name", first_quickly(task_names(), 10))
@pytest.mark.parametrize("size", SIZES)
def test_the_kitchen_is_beside_the_panel_and_above_the_keys(
    size: tuple[int, int], name: str
) -> None:
    problem = World(name).task.problem
    place = layout(size, problem.width, problem.height)
    assert pygame.Rect(0, 0, *size).contains(place.kitchen)
    assert place.kitchen.right <= place.panel.left
    assert place.kitchen.bottom <= place.size[1] - place.text * 3 // 2
    assert place.compact == (size[1] < 300)


def test_what_is_beside_a_kitchen_is_used() -> None:
    narrow, wide = layout((960, 720), 7, 7), layout((1280, 720), 7, 7)
    assert wide.text > narrow.text
    assert wide.wall < wide.tile, "the wall is lower where the kitchen would be smaller for it"
    assert wide.tile >= 85
    assert layout((2560, 1440), 7, 7).text == 2 * wide.text
    tall = layout((700, 900), 7, 7)
    assert tall.wall == tall.tile


@pytest.mark.parametrize("size", [11, 24])
@pytest.mark.parametrize("words", ["W" * 200, "厨房の" * 60, "مريم " * 40, "e\u0301" * 200])
def test_no_words_leave_a_form(size: int, words: str) -> None:
    rows = (
        Words(words), Button(words, 1), Choice(words, [(words, 1), ("no", 2)]),
        Choice("Look", [(words, 1)]), TextField("Name", words, 400),
    )  # fmt: skip
    surface = pygame.Surface((400, 900))
    surface.fill("red")
    area = pygame.Rect(40, 40, 320, 820)
    form = Form(words, rows)
    form.message = words
    form.draw(surface, area, Typesetter(), size)
    for edge in ((0, 0, 40, 900), (360, 0, 40, 900), (0, 0, 400, 40), (0, 860, 400, 40)):
        assert pygame.transform.average_color(surface, edge)[:3] == (255, 0, 0)
