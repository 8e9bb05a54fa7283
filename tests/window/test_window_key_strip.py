"""The line of keys below the kitchen, and notices above it, with letters of any size."""

from __future__ import annotations

from dataclasses import replace

import pygame
import pytest
from tests.support.window_play import Script

from robotouille import World
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import View

SCALES = (1.0, 1.3, 1.5, 1.6)
SIZES = [(1280, 720), (800, 600), (640, 360)]
KEYS = (("Arrows", "walk"), ("Tab", "all actions"), ("Esc", "leave"), ("H", "help"))
SENTENCE = "Some places are for work: carry something there, put it down, and press E."


class Written(Painter):
    """A painter that knows the words it has written since the last picture."""

    def __init__(self, scale: float) -> None:
        super().__init__(preferences=Preferences(text_scale=scale))
        self.words: list[str] = []
        line = self.text.line

        def kept(text: str, *others: object) -> pygame.Surface:
            self.words.append(text)
            return line(text, *others)  # type: ignore[arg-type]

        self.text.line = kept  # type: ignore[method-assign, assignment]

    def told(self, pointer: tuple[int, int] | None) -> tuple[str, ...]:
        return ()


def shown(view: View, overlay: UiOverlay, size: tuple[int, int], scale: float) -> str:
    painter = Written(scale)
    painter.paint(pygame.Surface(size), view, overlay)
    return " ".join(painter.words)


@pytest.fixture(scope="module")
def view() -> View:
    return Script(World("training/01")).view()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("prompt", ["", "Sound is off", "There is no free place that way"])
def test_what_the_context_key_does_is_always_told(
    view: View, size: tuple[int, int], scale: float, prompt: str
) -> None:
    hints = (("E", "Put down the bread"), ("Click", "Pick up the tomato"))
    words = shown(view, UiOverlay(prompt=prompt, hints=hints, keys=KEYS), size, scale)
    assert "Put down the bread" in words
    assert prompt in words


@pytest.mark.parametrize("scale", SCALES)
def test_of_the_other_keys_the_last_stay_longest(view: View, scale: float) -> None:
    hints = (("E", "Stack the cooked patty onto the lower half of the bun"),)
    words = shown(view, UiOverlay(hints=hints, keys=KEYS), (800, 600), scale).split()
    there = [key in words for key, _ in KEYS]
    assert there == sorted(there)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("lesson", ["Short.", SENTENCE, SENTENCE * 2])
def test_a_lesson_lies_over_the_wall_at_most(
    view: View, size: tuple[int, int], scale: float, lesson: str
) -> None:
    painter, surface = Painter(preferences=Preferences(text_scale=scale)), pygame.Surface(size)
    before = painter.layout(size, view.world)
    told = replace(view, lesson=lesson)
    painter.paint(surface, told)
    place = painter.layout(size, view.world)
    shown = painter._interruptions.draw(surface, place, told)
    assert all(area.bottom <= place.top for area in shown)
    assert place.corner((0, 0))[1] + place.tile <= place.strip.top
    painter.paint(surface, view)
    assert painter.layout(size, view.world) == before


@pytest.mark.parametrize("size", SIZES)
def test_nothing_moves_for_a_notice(view: View, size: tuple[int, int]) -> None:
    painter, surface = Painter(), pygame.Surface(size)
    before = painter.layout(size, view.world)
    painter.paint(surface, replace(view, notice=SENTENCE))
    assert painter.layout(size, view.world) == before


def test_lessons_of_one_line_and_of_two_leave_the_kitchen_where_it_is(view: View) -> None:
    painter, surface, size = Painter(), pygame.Surface((1280, 720)), (1280, 720)
    found = []
    for lesson in ("Short.", SENTENCE):
        painter.paint(surface, replace(view, lesson=lesson))
        found.append(painter.layout(size, view.world))
    assert found[0] == found[1]


def test_what_is_told_is_not_said_twice_and_advice_has_no_key(view: View) -> None:
    advice = "Fill the pot with water first"
    for prompt in ("", advice):
        overlay = UiOverlay(hints=(("", advice),), prompt=prompt)
        assert shown(view, overlay, (800, 600), 1.0).split().count("Fill") == 1
