"""Layout at any size: nothing is cut off, and labels do not overlap."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pygame
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.samples import quick_sample
from tests.support.window_play import world_of

from robotouille import World, task_names
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.tags.label_placement import Place, PlacedLabel, place_labels
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Choice, TextField, Words
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


@pytest.mark.parametrize("size", quick_sample(((size,) for size in SIZES), 2))
@pytest.mark.parametrize(
    "task", quick_sample(["multi_agent/10@4", "asynchronous/10", "workshop/02"])
)
def test_the_panel_is_not_cut_off(size: tuple[int, int], task: str) -> None:
    world = world_of(task)
    painter, surface = Painter(), pygame.Surface(size)
    for waits_for in ((), world.players[::-1]):
        painter.paint(surface, replace(crowded(world), waits_for=waits_for))
        place = painter.layout(size, world)
        panel, margin = place.panel, place.text // 2
        for edge in (
            pygame.Rect(panel.left + 2, 0, margin - 2, panel.height),
            pygame.Rect(panel.right - margin, 0, margin, panel.height),
            pygame.Rect(panel.left + 2, panel.bottom - margin, panel.width - 2, margin),
        ):
            found = pygame.transform.average_color(surface, edge)[:3]
            assert all(abs(a - b) <= 1 for a, b in zip(found, PANEL, strict=True)), edge


@pytest.mark.parametrize("name", quick_sample(task_names(), 10))
@pytest.mark.parametrize("size", SIZES)
def test_the_kitchen_is_left_of_the_panel_and_above_the_keys(
    size: tuple[int, int], name: str
) -> None:
    problem = world_of(name).task.problem
    place = layout(size, problem.width, problem.height)
    assert pygame.Rect(0, 0, *size).contains(place.kitchen)
    assert place.kitchen.right <= place.panel.left
    assert place.kitchen.bottom <= place.size[1] - place.text * 3 // 2
    assert place.compact == (size[1] < 300)


@pytest.mark.parametrize("size", [11, 24])
@pytest.mark.parametrize("words", ["W" * 200, "厨房の" * 60, "مريم " * 40, "e\u0301" * 200])
def test_long_words_stay_inside_a_form(size: int, words: str) -> None:
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


AREA = pygame.Rect(10, 20, 300, 200)

corners = st.tuples(st.integers(-50, 350), st.integers(-50, 250))
rects = st.builds(
    pygame.Rect, st.integers(0, 300), st.integers(0, 200), st.integers(1, 90), st.integers(1, 60)
)
labels = st.builds(
    PlacedLabel,
    key=st.integers(0, 1_000_000),
    size=st.tuples(st.integers(1, 160), st.integers(1, 90)),
    choices=st.lists(corners, min_size=1, max_size=4).map(tuple),
    importance=st.integers(0, 3),
    reach=st.none(),
    stays=st.just(value=True),
)
many = st.lists(labels, max_size=8, unique_by=lambda label: label.key)


@pytest.mark.slow
@settings(max_examples=40)
@given(many, st.lists(rects, max_size=8), st.lists(rects, max_size=4))
def test_labels_do_not_overlap_or_leave_the_area(labels, blocked, avoided) -> None:
    places = place_labels(labels, AREA, blocked, avoided)
    sizes = {label.key: label.size for label in labels}
    for key, place in places.items():
        assert place.area.size == sizes[key]
        assert AREA.contains(place.area)
        assert place.area.collidelist(blocked) < 0
    for one, other in itertools.combinations(places.values(), 2):
        assert not one.area.colliderect(other.area)
    assert places == place_labels(labels, AREA, blocked, avoided)


@settings(max_examples=40)
@given(many, st.lists(rects, max_size=5))
def test_dropped_labels_fit_nowhere(labels, blocked) -> None:
    places = place_labels(labels, AREA, blocked)
    order = sorted(labels, key=lambda label: -label.importance)
    for label in labels:
        if label.key in places:
            continue
        before = order[: order.index(label)]
        taken = [*blocked, *(places[x.key].area for x in before if x.key in places)]
        width, height = label.size
        for x in range(AREA.left, AREA.right - width + 1, 7):
            for y in range(AREA.top, AREA.bottom - height + 1, 7):
                assert pygame.Rect(x, y, width, height).collidelist(taken) >= 0


@settings(max_examples=40)
@given(many, st.lists(rects, max_size=5), st.tuples(st.integers(-2, 2), st.integers(-2, 2)))
def test_labels_stay_in_the_next_frame(labels, blocked, moved) -> None:
    first = place_labels(labels, AREA, blocked)
    again = place_labels(labels, AREA, blocked, before=first)
    assert {k: p.area for k, p in again.items()} == {k: p.area for k, p in first.items()}
    follows = PlacedLabel("a", (40, 20), ((100, 100), (100, 150)))
    held = {"a": Place(pygame.Rect(100, 150, 40, 20), (0, 50))}
    x, y = moved
    later = PlacedLabel("a", (40, 20), ((100 + x, 100 + y), (100 + x, 150 + y)))
    assert place_labels([follows], AREA, before=held)["a"].area.topleft == (100, 150)
    assert place_labels([later], AREA, before=held)["a"].area.topleft == (100 + x, 150 + y)
