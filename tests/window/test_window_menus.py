"""The settings, what is typed, keys that are held, and forms in windows of every size."""

from __future__ import annotations

from pathlib import Path

import pygame
import pytest
from tests.support.forms import asked, ctrl, drawn, typesetter
from tests.support.golden_screens import SCREENS
from tests.support.window_play import follow, post

from robotouille import World
from robotouille.domain.rendering import NO_WORDS, language_of, read_language
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.picker import Picker
from robotouille_client.window.forms.repeats import FIRST, NEXT
from robotouille_client.window.forms.screen import text_size
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.forms.widgets import Button, Choice, Look, Row, Slider
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.hands.controls import Controls
from robotouille_client.window.shell.screens.server_menus import JoinMenu
from robotouille_client.window.shell.screens.settings_menu import KeysMenu, SettingsMenu
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.shell.user_interface import UserInterface
from robotouille_server.runtime.workers import plain_code

# Settings


def test_settings_count_at_once(display: Display) -> None:
    settings = Settings()
    told: list[str] = []

    def changed(field: str) -> str:
        told.append(field)
        return ""

    form = SettingsMenu(settings, changed).form
    for label in ("Sound", "What moves", "Size of letters", "Colours"):
        row = next(row for row in form.rows if row.label == label)
        form.focus(row)
        post(pygame.K_RIGHT)
        follow(form)
    form.focus(form.rows[0])
    ctrl(pygame.K_a)
    post("Ada", pygame.K_ESCAPE)
    follow(form)
    now = settings.preferences
    assert (now.sound, now.reduced_motion, now.text_scale) == (False, True, 1.1)
    assert now.name == "Ada"
    assert now.strong_contrast
    assert told[:4] == ["sound", "reduced_motion", "text_scale", "strong_contrast"]
    assert form.result == "back"


def test_an_empty_name_is_none(display: Display) -> None:
    settings = Settings(name="Ada")
    form = SettingsMenu(settings).form
    ctrl(pygame.K_a)
    post(pygame.K_BACKSPACE)
    follow(form)
    assert settings.preferences.name == "Ada"


def test_keys_as_they_were_stays_and_a_key_that_is_taken_is_told(display: Display) -> None:
    told: list[KeyMap] = []
    asking = KeysMenu(KeyMap({"chat": ["y"]}), told.append)
    form = asking.form
    help_row = next(row for row in form.rows if row.label == "Help")
    form.focus(help_row)
    post(pygame.K_RETURN, pygame.K_y)
    follow(form)
    assert told[-1].changed == {"chat": [], "help": ["y"]}
    assert form.message == "No key any more: Say something."
    form.focus(next(row for row in form.rows if row.label == "As they were"))
    post(pygame.K_RETURN)
    follow(form)
    assert told[-1].changed == {}
    assert form.result is None


# Text


def test_a_field_is_edited(display: Display, monkeypatch: pytest.MonkeyPatch) -> None:
    field = TextField("Code", "abcd", 12)
    form = Form("Join", [field, Button("Play", "play")])
    post(pygame.K_LEFT, pygame.K_LEFT, "X", pygame.K_DELETE, pygame.K_HOME, "-", pygame.K_END, "!")
    follow(form)
    assert field.text == "-abXd!"
    copied: list[str] = []
    monkeypatch.setattr(pygame.scrap, "put_text", copied.append)
    monkeypatch.setattr(pygame.scrap, "get_text", lambda: " kqxzb-mhtwa-and-more\n")
    ctrl(pygame.K_a)
    ctrl(pygame.K_x)
    ctrl(pygame.K_v)
    follow(form)
    assert copied == ["-abXd!"]
    assert field.text == "kqxzb-mhtwa-", "what has room"
    ctrl(pygame.K_a)
    post("z")
    follow(form)
    assert field.text == "z"
    monkeypatch.setattr(pygame.scrap, "get_text", broken)
    ctrl(pygame.K_v)
    follow(form)
    assert field.text == "z"


def broken() -> str:
    raise pygame.error("no clipboard")


@pytest.mark.parametrize("typed", ["kqxzb mhtwa", " KQXZB-MHTWA ", "kqxzbmhtwa\t"])
def test_a_code_as_people_write_it(display: Display, typed: str) -> None:
    settings = Settings()
    asking = JoinMenu(settings)
    asking.form.focused.letters(typed)  # type: ignore[union-attr]
    asking.remember(settings)
    assert plain_code(settings.code) == "KQXZBMHTWA"


# Keys that are held, and what comes too early


def test_a_key_that_is_held_goes_on(display: Display) -> None:
    field = TextField("Name", "x" * 40)
    form = Form("Title", [field])

    def down() -> None:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_BACKSPACE, mod=0))

    def up() -> None:
        pygame.event.post(pygame.Event(pygame.KEYUP, key=pygame.K_BACKSPACE, mod=0))

    asked(display, form, down, *[lambda: None] * (FIRST + 4 * NEXT), up)
    assert len(field.text) == 40 - 1 - 5


def test_enter_does_not_go_on(display: Display) -> None:
    form = Form("Title", [Choice("Task", [("a", 1), ("b", 2)]), Button("Go", "go")])
    form.focus(form.rows[1])

    def down() -> None:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_RETURN, mod=0))

    assert asked(display, form, down) == "go"
    again = Form("Title", [Button("Go", "go")])
    assert asked(display, again) is None


def test_what_is_pressed_behind_an_answer_is_for_the_next_form(display: Display) -> None:
    post(pygame.K_RETURN, pygame.K_DOWN, pygame.K_RETURN)
    assert asked(display, Form("One", [Button("A", "a"), Button("B", "b")])) == "a"
    assert asked(display, Form("Two", [Button("C", "c"), Button("D", "d")])) == "d"


def test_a_gamepad_that_is_unplugged_while_a_direction_is_held(display: Display) -> None:
    rows = [TextField("Name", "ada"), *(Button(str(n), n) for n in range(30))]
    form = Form("Title", rows)

    def tilt() -> None:
        axis = pygame.CONTROLLER_AXIS_LEFTY
        event = pygame.Event(pygame.CONTROLLERAXISMOTION, axis=axis, value=32_000, instance_id=0)
        pygame.event.post(event)

    def unplug() -> None:
        pygame.event.post(pygame.Event(pygame.CONTROLLERDEVICEREMOVED, instance_id=0))

    nothing = [lambda: None] * (FIRST + NEXT)
    asked(display, form, tilt, *nothing, unplug)
    assert form.focused is rows[1 + 2], "held, it went on; unplugged, it stopped"
    assert "unplugged" in form.message
    post("x", pygame.K_UP)
    form.focus(rows[0])
    follow(form)
    assert rows[0].text == "adax"  # type: ignore[attr-defined]


# The display


def test_the_size_before_a_full_screen_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    display = Display((800, 600), headless=True)
    display.open()
    (desktop,) = pygame.display.get_desktop_sizes()
    display.toggle_fullscreen()
    assert display.surface is not None
    assert display.surface.get_size() == desktop
    display.toggle_fullscreen()
    late = pygame.Event(pygame.VIDEORESIZE, w=desktop[0], h=desktop[1], size=desktop)
    display.handle(late)
    assert display.size == (800, 600)
    display.handle(pygame.Event(pygame.VIDEORESIZE, w=700, h=500, size=(700, 500)))
    assert display.size == (700, 500)
    display.close()


# Every size


@pytest.mark.parametrize(
    ("size", "scale"),
    [
        ((320, 240), 0.8), ((320, 240), 1.0), ((320, 240), 1.6), ((640, 480), 1.0),
        ((640, 480), 1.6), ((1120, 630), 1.0), ((3840, 2160), 1.0),
    ],
)  # fmt: skip
def test_every_row_can_be_reached_and_is_inside(
    display: Display, size: tuple[int, int], scale: float
) -> None:
    inside = pygame.Rect((0, 0), size)
    first = 100 if size[0] <= 320 else 3 if size[0] < 2000 else 0  # Small windows are hard.
    for name, made in SCREENS.items():
        form = made()
        rows = [row for row in form.rows if row.focusable]
        for number, _ in enumerate(rows):
            if first < number < len(rows) - 1:
                form.command(Command.DOWN)
                continue
            drawn(form, size, scale)
            row = form.focused
            assert row is not None
            place = form.place_of(row)
            assert place is not None, (name, row.label)
            assert inside.contains(place), (name, row.label)
            look_height = row_height(row, place.width, size, scale)
            assert place.height == look_height, (name, row.label, "is cut off")
            form.command(Command.DOWN)
        assert form.focused is rows[0] or name in ("menu", "tasks"), "round and round"


def row_height(row: Row, width: int, size: tuple[int, int], scale: float) -> int:
    return row.height(Look(typesetter(), text_size(size, scale), focused=False), width)


def test_a_long_list_has_a_mark_that_can_be_dragged(display: Display) -> None:
    form = Form("Title", [Button(str(n), n) for n in range(40)], pinned=1)
    drawn(form, (400, 300))
    bar = form.scroll_bar
    assert bar.width
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=bar.midbottom, button=1))
    pos = (bar.centerx, bar.bottom - 1)
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1))
    follow(form)
    assert form.focused is form.rows[39]
    pos = (bar.centerx, bar.y)
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(1, 0, 0)))
    follow(form)
    assert form.focused is form.rows[0]
    few = Form("Title", [Button("1", 1)])
    drawn(few, (400, 300))
    assert not few.scroll_bar.width


def test_a_slider_is_only_its_track(display: Display) -> None:
    form = SettingsMenu(Settings()).form
    slider = next(row for row in form.rows if isinstance(row, Slider))
    slider.click(0.05)
    assert slider.value == 1.0


def test_a_picker_without_entries_says_so(display: Display) -> None:
    form = Picker("Replays", [], [Button("Back", "back")], empty="None yet.")
    drawn(form, (400, 300))
    assert form.rows[0].label == "None yet."
    form.command(Command.RIGHT)
    assert form.focused is form.rows[1]


# Words of one's own


def test_words_of_ones_own_are_laid_over_those_of_the_kitchen(tmp_path: Path) -> None:
    file = tmp_path / "deutsch.json"
    file.write_text('{"kinds": {"lettuce": "Salat"}, "actions": {"cut": "{i1} schneiden"}}')
    world = World("synchronous/02")
    over = language_of(world.task).with_words(read_language(file))
    assert over.kinds["lettuce"][0].name == "Salat"
    assert over.kinds["bottombun"] == language_of(world.task).kinds["bottombun"]
    me, state = world.players[0], world.initial
    words = Controls(world, language=over).wording(me)
    cut = world.action("cut", me, "lettuce1", "board1")
    assert "Salat schneiden" in words.action(cut, state)
    assert language_of(world.task).with_words(NO_WORDS) == language_of(world.task)


def test_the_language_file_is_a_setting_and_its_faults_are_told(
    tmp_path: Path, display: Display
) -> None:
    file = tmp_path / "words.json"
    file.write_text('{"kinds": {"lettuce": "Salat"}}')
    settings = Settings(language_file=str(file))
    ui = UserInterface(settings, display)
    assert ui.words.kinds["lettuce"][0].name == "Salat"
    assert not ui.words_fault
    for broken_words, told in (
        ('{"kind": {}}', "kind"), ("{", "broken.json"), ('{"actions": {"cut": 3}}', "cut"),
    ):  # fmt: skip
        (tmp_path / "broken.json").write_text(broken_words)
        settings.prefer(language_file=str(tmp_path / "broken.json"))
        ui.follow_settings()
        assert ui.words == NO_WORDS
        assert told in ui.words_fault
        settings.prefer(language_file="")
        ui.follow_settings()
    settings.prefer(language_file=str(tmp_path / "none.json"))
    ui.follow_settings()
    assert "none.json" in ui.words_fault
