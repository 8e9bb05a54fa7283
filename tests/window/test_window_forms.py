"""Forms with mouse and keyboard: focus, letters, keys and scrolling."""

from __future__ import annotations

import pygame
import pytest
from tests.support.window_play import follow, post

from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import (
    Button,
    Choice,
    KeyField,
    Row,
    Slider,
    Words,
)
from robotouille_client.window.input.commands import KeyMap
from robotouille_client.window.pictures.text_surfaces import Typesetter

KEYS = KeyMap()
AREA = pygame.Rect(0, 0, 400, 300)


pytestmark = pytest.mark.usefixtures("display")


def drawn(form: Form, area: pygame.Rect = AREA) -> pygame.Surface:
    surface = pygame.Surface(area.size)
    form.draw(surface, area, Typesetter(), 14)
    return surface


def click(form: Form, row: Row, share: float = 0.5) -> None:
    drawn(form)
    area = form.place_of(row)
    pos = (area.x + round(area.width * share), area.centery)
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(0, 0, 0)))
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1))
    follow(form)


def test_words_take_no_focus_and_escape_cancels() -> None:
    form = Form("Title", [Words("Hello"), Button("One", 1), Words("and"), Button("Two", 2)])
    assert form.focused is form.rows[1]
    post(pygame.K_DOWN)
    follow(form)
    assert form.focused is form.rows[3]
    post(pygame.K_DOWN, pygame.K_UP, pygame.K_UP)
    follow(form)
    assert form.focused is form.rows[1]
    post(pygame.K_ESCAPE)
    follow(form)
    assert form.result == "back"


@pytest.mark.parametrize("key", [pygame.K_RETURN, pygame.K_e, pygame.K_SPACE])
def test_buttons_by_keys(key: int) -> None:
    form = Form("Title", [Button("One", 1)])
    post(key)
    follow(form)
    assert form.result == 1


def test_a_button_by_mouse() -> None:
    form = Form("Title", [Button("One", 1), Button("Two", 2)])
    click(form, form.rows[1])
    assert form.result == 2


def test_a_choice_by_keys_and_mouse() -> None:
    received: list[object] = []
    choice = Choice("Task", [("a", 1), ("b", 2), ("c", 3)], 2, received.append)
    form = Form("Title", [choice])
    post(pygame.K_RIGHT, pygame.K_RIGHT, pygame.K_LEFT)
    follow(form)
    click(form, choice, 0.95)
    click(form, choice, 0.6)
    assert received == [3, 1, 3, 1, 3]
    assert Choice("x", [("a", 1)], "none of them").value == 1


def test_a_slider_by_keys_and_mouse() -> None:
    slider = Slider("Pace", 5, 1, 9, 1)
    form = Form("Title", [slider])
    post(pygame.K_LEFT, pygame.K_LEFT)
    follow(form)
    assert slider.value == 3
    click(form, slider, 0.76)
    assert slider.value == 9
    for beside in (0.1, 0.3, 0.9):
        click(form, slider, beside)
        assert slider.value == 9, "only the track is for clicks"
    post(pygame.K_RIGHT)
    follow(form)
    assert slider.value == 9
    click(form, slider, 0.41)
    assert slider.value == 1


def test_a_key_field_takes_a_key_and_escape_keeps_the_old_one() -> None:
    received: list[str] = []
    form = Form("Keys", [KeyField("Use", "e", received.append)])
    post(pygame.K_RETURN, pygame.K_LEFT, pygame.K_RETURN, pygame.K_ESCAPE)
    follow(form)
    assert received == ["left"]
    assert form.result is None
    post(pygame.K_ESCAPE)
    follow(form)
    assert form.result == "back"
