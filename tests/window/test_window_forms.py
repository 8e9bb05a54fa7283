"""Forms by mouse and keys: rows, focus, letters, keys, scrolling."""

from __future__ import annotations

import pygame
import pytest
from tests.support.window_play import follow, post

from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.forms.widgets import Button, Choice, KeyField, Row, Slider, Words
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.shell.screens.settings_menu import SettingsMenu
from robotouille_client.window.shell.screens.thumbnails import Thumbnails
from robotouille_client.window.shell.settings import Settings

KEYS = KeyMap()
AREA = pygame.Rect(0, 0, 400, 300)


@pytest.fixture(autouse=True)
def display():  # type: ignore[no-untyped-def]
    opened = Display((400, 300), headless=True)
    opened.open()
    pygame.event.clear()
    yield opened
    opened.close()


def drawn(form: Form, area: pygame.Rect = AREA) -> pygame.Surface:
    surface = pygame.Surface(area.size)
    form.draw(surface, area, Typesetter(), 14)
    return surface


def click(form: Form, row: Row, share: float = 0.5) -> None:
    drawn(form)
    area = form.place_of(row)
    assert area is not None
    pos = (area.x + round(area.width * share), area.centery)
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(0, 0, 0)))
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1))
    follow(form)


def test_words_have_no_focus_and_escape_is_a_result() -> None:
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


def test_letters_go_to_a_field_and_mean_nothing_else() -> None:
    field = TextField("Name", "ad", 5)
    form = Form("Title", [field, Button("Done", "done")])
    for letter in "a es":
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.key.key_code(
            "space" if letter == " " else letter), mod=0, unicode=letter))  # fmt: skip
        pygame.event.post(pygame.Event(pygame.TEXTINPUT, text=letter))
    follow(form)
    assert field.text == "ada e"
    assert form.focused is field
    post(pygame.K_BACKSPACE, pygame.K_BACKSPACE, pygame.K_RETURN)
    follow(form)
    assert field.text == "ada"
    assert form.focused is form.rows[1], "Enter leads on"
    assert form.result is None


def test_a_choice_by_keys_and_mouse() -> None:
    told: list[object] = []
    choice = Choice("Task", [("a", 1), ("b", 2), ("c", 3)], 2, told.append)
    form = Form("Title", [choice])
    post(pygame.K_RIGHT, pygame.K_RIGHT, pygame.K_LEFT)
    follow(form)
    click(form, choice, 0.95)
    click(form, choice, 0.6)
    assert told == [3, 1, 3, 1, 3]
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


def test_a_key_is_asked_for_and_escape_keeps_the_old_one() -> None:
    told: list[str] = []
    form = Form("Keys", [KeyField("Use", "e", told.append)])
    post(pygame.K_RETURN, pygame.K_LEFT, pygame.K_RETURN, pygame.K_ESCAPE)
    follow(form)
    assert told == ["left"]
    assert form.result is None
    post(pygame.K_ESCAPE)
    follow(form)
    assert form.result == "back"


def test_many_rows_are_scrolled_to() -> None:
    form = Form("Title", [Button(str(n), n) for n in range(40)])
    drawn(form)
    assert form.place_of(form.rows[0])
    assert not form.place_of(form.rows[30])
    for _ in range(30):
        form.command(Command.DOWN)
    drawn(form)
    assert form.place_of(form.rows[30])
    wheel = pygame.Event(pygame.MOUSEWHEEL, y=1)
    form.handle(wheel, KEYS)
    assert form.focused is form.rows[29]


@pytest.mark.parametrize("size", [(160, 120), (320, 240), (3840, 2160)])
def test_every_size_and_any_words(size: tuple[int, int]) -> None:
    rows = [
        Words("word " * 60), TextField("Name", "龍" * 40), Choice("Long " * 20, [("x" * 99, 1)]),
        Slider("Pace", 1, 0, 2, 1), KeyField("Use", "", print), Button("ö" * 80, 1),
    ]  # fmt: skip
    form = Form("A title that is long " * 5, rows, picture=pygame.Surface)
    form.message = "Words " * 40
    drawn(form, pygame.Rect(0, 0, *size))


def test_the_look_of_kitchens_is_a_setting() -> None:
    settings = Settings()
    menu = SettingsMenu(settings)
    look = next(row for row in menu.form.rows if row.label == "Look")
    look.command(Command.USE)
    assert settings.preferences.rendering == "chalk"
    usual, chalk = Thumbnails(), Thumbnails("chalk")
    assert usual.at("synchronous/01", (60, 60)) is None, "it is drawn when there is time"
    for pictures in (usual, chalk):
        pictures.at("synchronous/01", (60, 60))
        assert pictures.load()
    one, other = (pictures.at("synchronous/01", (60, 60)) for pictures in (usual, chalk))
    assert one is not None
    assert other is not None
    assert one.get_size() == other.get_size()
    assert pygame.image.tobytes(one, "RGB") != pygame.image.tobytes(other, "RGB")
