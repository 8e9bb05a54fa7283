"""Settings, fields, held keys, and forms in windows of every size."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.forms import asked, ctrl, drawn, typesetter
from tests.support.golden_screens import SCREENS
from tests.support.samples import quick_sample
from tests.support.window_play import follow, post
from tests.support.window_session import WindowSession

from robotouille import World
from robotouille.domain.rendering import NO_WORDS, language_of, read_language
from robotouille_client.window.app.main_menu import KeysMenu, SettingsMenu
from robotouille_client.window.app.server_menus import JoinMenu, OpenMenu
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.app.user_interface import UserInterface
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.picker import Picker
from robotouille_client.window.forms.screen import FIRST, NEXT, Display, text_size
from robotouille_client.window.forms.widgets import Button, Choice, DrawContext, Row, TextField
from robotouille_client.window.input.commands import Command, KeyMap
from robotouille_client.window.input.controls import Controls

# Settings


def test_settings_apply_at_once(display: Display) -> None:
    settings = Settings()
    received: list[str] = []

    def changed(field: str) -> str:
        received.append(field)
        return ""

    form = SettingsMenu(settings, changed).form
    for label in ("Sound", "Animation", "Text size", "Contrast"):
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
    assert received[:4] == ["sound", "reduced_motion", "text_scale", "strong_contrast"]
    assert form.result == "back"


def test_an_empty_name_is_ignored(display: Display) -> None:
    settings = Settings(name="Ada")
    form = SettingsMenu(settings).form
    ctrl(pygame.K_a)
    post(pygame.K_BACKSPACE)
    follow(form)
    assert settings.preferences.name == "Ada"


def test_reset_keys_and_report_a_key_that_was_taken(display: Display) -> None:
    received: list[KeyMap] = []
    asking = KeysMenu(KeyMap({"chat": ["y"]}), received.append)
    form = asking.form
    help_row = next(row for row in form.rows if row.label == "Help")
    form.focus(help_row)
    post(pygame.K_RETURN, pygame.K_y)
    follow(form)
    assert received[-1].changed == {"chat": [], "help": ["y"]}
    assert form.message == "No key left for: Chat."
    form.focus(next(row for row in form.rows if row.label == "Reset to defaults"))
    post(pygame.K_RETURN)
    follow(form)
    assert received[-1].changed == {}
    assert form.result is None


# Text


def test_captions_have_no_characters_that_the_system_refuses(display: Display) -> None:
    """A server chooses the code in the caption, and a NUL ended the window."""
    display.caption = "Robotouille A\0B\n\ud800\u202e" + "x" * 10_000
    assert pygame.display.get_caption()[0] == display.caption
    assert display.caption.startswith("Robotouille A B")
    assert display.caption.isprintable()
    assert len(display.caption) < 1_000
    other = Display((320, 240), caption="A\0B", headless=True)
    other.open()
    assert pygame.display.get_caption()[0] == "A B"


def test_editing_a_field(display: Display, monkeypatch: pytest.MonkeyPatch) -> None:
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


# Keys that are held, and what comes too early


def test_a_held_key_repeats(display: Display) -> None:
    field = TextField("Name", "x" * 40)
    form = Form("Title", [field])

    def down() -> None:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_BACKSPACE, mod=0))

    def up() -> None:
        pygame.event.post(pygame.Event(pygame.KEYUP, key=pygame.K_BACKSPACE, mod=0))

    asked(display, form, down, *[lambda: None] * (FIRST + 4 * NEXT), up)
    assert len(field.text) == 40 - 1 - 5


def test_enter_does_not_repeat(display: Display) -> None:
    form = Form("Title", [Choice("Task", [("a", 1), ("b", 2)]), Button("Go", "go")])
    form.focus(form.rows[1])

    def down() -> None:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_RETURN, mod=0))

    assert asked(display, form, down) == "go"
    again = Form("Title", [Button("Go", "go")])
    assert asked(display, again) is None


def test_input_after_an_answer_goes_to_the_next_form(display: Display) -> None:
    post(pygame.K_RETURN, pygame.K_DOWN, pygame.K_RETURN)
    assert asked(display, Form("One", [Button("A", "a"), Button("B", "b")])) == "a"
    assert asked(display, Form("Two", [Button("C", "c"), Button("D", "d")])) == "d"


def test_disconnecting_a_gamepad_stops_the_repetition(display: Display) -> None:
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
    assert "disconnected" in form.message
    post("x", pygame.K_UP)
    form.focus(rows[0])
    follow(form)
    assert rows[0].text == "adax"


# The display


def test_the_size_before_full_screen_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    display = Display((800, 600), headless=True)
    display.open()
    (desktop,) = pygame.display.get_desktop_sizes()
    display.toggle_fullscreen()
    assert display.surface.get_size() == desktop
    display.toggle_fullscreen()
    late = pygame.Event(pygame.VIDEORESIZE, w=desktop[0], h=desktop[1], size=desktop)
    display.handle(late)
    assert display.size == (800, 600)
    display.handle(pygame.Event(pygame.VIDEORESIZE, w=700, h=500, size=(700, 500)))
    assert display.size == (700, 500)


# Every size


@pytest.mark.parametrize(
    ("size", "scale"),
    quick_sample([
        ((320, 240), 1.6), ((1120, 630), 1.0), ((320, 240), 0.8), ((320, 240), 1.0),
        ((640, 480), 1.0), ((640, 480), 1.6), ((1920, 1080), 1.0),
    ], 2),
)  # fmt: skip
def test_every_row_is_reachable_and_visible(
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
            place = form.place_of(row)
            assert place is not None, (name, row.label)
            assert inside.contains(place), (name, row.label)
            look_height = row_height(row, place.width, size, scale)
            assert place.height == look_height, (name, row.label, "is cut off")
            form.command(Command.DOWN)
        assert form.focused is rows[0] or name in ("menu", "tasks"), "round and round"


def row_height(row: Row, width: int, size: tuple[int, int], scale: float) -> int:
    return row.height(DrawContext(typesetter(), text_size(size, scale), focused=False), width)


def test_the_scroll_bar_can_be_dragged(display: Display) -> None:
    form = Form("Title", [Button(str(n), n) for n in range(40)], layout=FormLayout(pinned=1))
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


def test_a_picker_without_entries_says_so(display: Display) -> None:
    form = Picker("Replays", [], [Button("Back", "back")], empty="None yet.")
    drawn(form, (400, 300))
    assert form.rows[0].label == "None yet."
    form.command(Command.RIGHT)
    assert form.focused is form.rows[1]


# Words of one's own


def test_own_words_replace_those_of_the_kitchen(tmp_path: Path) -> None:
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


def test_faults_of_the_language_file_are_reported(tmp_path: Path, display: Display) -> None:
    file = tmp_path / "words.json"
    file.write_text('{"kinds": {"lettuce": "Salat"}}')
    settings = Settings(language_file=str(file))
    ui = UserInterface(settings, display)
    assert ui.words.kinds["lettuce"][0].name == "Salat"
    assert not ui.words_fault
    for broken_words, received in (
        ('{"kind": {}}', "kind"), ("{", "broken.json"), ('{"actions": {"cut": 3}}', "cut"),
    ):  # fmt: skip
        (tmp_path / "broken.json").write_text(broken_words)
        settings.prefer(language_file=str(tmp_path / "broken.json"))
        ui.apply_settings()
        assert ui.words == NO_WORDS
        assert received in ui.words_fault
        settings.prefer(language_file="")
        ui.apply_settings()
    settings.prefer(language_file=str(tmp_path / "none.json"))
    ui.apply_settings()
    assert "none.json" in ui.words_fault


def test_enter_in_any_field_leads_to_the_main_button(display: Display) -> None:
    for form, main in ((JoinMenu(Settings()).form, "Play"), (OpenMenu(Settings()).form, "Open")):
        for field in [row for row in form.rows if isinstance(row, TextField)]:
            form.focus(field)
            form.command(Command.ENTER)
            assert form.focused.label.startswith(main)
            assert form.result is None


def test_typing_replaces_the_code_and_a_second_click_edits_it(display: Display) -> None:
    form = JoinMenu(Settings(code="ABC")).form
    code = form.focused
    assert isinstance(code, TextField)
    post("x")
    follow(form)
    assert code.text == "x"
    form.command(Command.DOWN)
    form.command(Command.UP)
    assert code.selected
    code.click(0.5)
    post("y")
    follow(form)
    assert code.text == "xy"
    code.click(0.5)
    assert code.selected


def test_typing_an_address_clears_the_error(display: Display) -> None:
    for form in (JoinMenu(Settings(), "Nobody.").form, OpenMenu(Settings(), "Nobody.").form):
        server = next(row for row in form.rows if row.label == "Server")
        form.focus(server)
        assert form.message == "Nobody."
        server.letters("0")
        assert form.message == ""


def test_letters_on_a_button_go_to_the_last_field(display: Display) -> None:
    form = OpenMenu(Settings(server="ws://a")).form
    server = next(row for row in form.rows if row.label == "Server")
    assert isinstance(server, TextField)
    form.focus(server)
    form.command(Command.DOWN)
    assert form.focused.label == "Back"
    post("e", "s")
    follow(form)
    assert form.result is None
    assert (server.text, form.focused) == ("ws://aes", server)


@pytest.mark.parametrize("menu", [JoinMenu, OpenMenu])
async def test_entries_are_kept_when_going_back(
    display: Display, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, menu: type
) -> None:
    session = WindowSession(tmp_path)
    session.watch(monkeypatch)

    def script() -> Iterator[None]:
        yield
        label = "Join with a code" if menu is JoinMenu else "Open a kitchen"
        yield from session.choose(label)
        server = next(row for row in session.form.rows if row.label == "Server")
        session.form.focus(server)
        server.letters("0")
        yield from session.choose("Back")
        assert session.form.focused.label == label, "the menu comes back where one was"
        yield from session.choose("Quit")

    await session.go(script)
    assert session.app.ui.preferences.server == "ws://127.0.0.1:87650"
