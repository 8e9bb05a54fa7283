"""The lists of tasks and of recordings, the settings, and what is typed, by posted events."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta, timezone
from functools import cache
from pathlib import Path

import pygame
import pytest
from tests.support.golden_screens import SCREENS, proven_game
from tests.support.window_play import follow, post

from robotouille import State, World, load_task
from robotouille.domain.loading import task_names
from robotouille.domain.rendering import NO_WORDS, Language, language_of, read_language
from robotouille.planning.policies import RandomPolicy
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille.replay.container import frame_ends, plain
from robotouille_client.bots.partners import PromptPartners
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.picker import Picker, PickerEntry, Told
from robotouille_client.window.forms.repeats import FIRST, NEXT
from robotouille_client.window.forms.screen import Screen, text_size
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.forms.widgets import Button, Choice, Look, Row, Slider, Words
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.hands.controls import Controls
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.shell.games.local_game import LocalGame
from robotouille_client.window.shell.screens import task_picker
from robotouille_client.window.shell.screens.play_menu import PlayMenu
from robotouille_client.window.shell.screens.recording_summary import summary_of, when_words
from robotouille_client.window.shell.screens.replays_menu import ReplaysMenu, recent_recordings
from robotouille_client.window.shell.screens.server_menus import JoinMenu
from robotouille_client.window.shell.screens.settings_menu import KeysMenu, SettingsMenu
from robotouille_client.window.shell.screens.task_picker import TaskPicker
from robotouille_client.window.shell.screens.thumbnails import Thumbnails
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.shell.user_interface import UserInterface
from robotouille_client.window.sources.task_titles import dish_title, task_title
from robotouille_server.runtime.workers import plain_code

BURGER = "multi_agent/01_lettuce_burger"


def ctrl(key: int) -> None:
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=pygame.KMOD_LCTRL, unicode=""))


def asked(display: Display, form: Form, *frames: Callable[[], None]) -> object:
    """Ask a form; something is done in each frame, then the window waits a while."""
    doing = iter(frames)

    async def sleep(seconds: float) -> None:
        next(doing, lambda: None)()
        await asyncio.sleep(0)

    async def main() -> object:
        until: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        ticks = iter([*[None] * (len(frames) + 60)])

        async def limited(seconds: float) -> None:
            await sleep(seconds)
            if next(ticks, 1) == 1 and not until.done():
                until.set_result(None)

        return await Screen(display, sleep=limited).ask(form, until)

    return asyncio.run(main())


# What is picked


def test_a_task_is_found_by_typing_and_taken_by_enter(display: Display) -> None:
    form = TaskPicker(Settings(), "synchronous/01_cheese_sandwich").form
    assert len(form.entries) == len(task_names())
    assert form.focused is not None
    assert form.focused.answer == "synchronous/01_cheese_sandwich"
    post("Lettuce bur")
    follow(form)
    found = [row.answer for row in form.rows if isinstance(row, PickerEntry)]
    assert BURGER in found
    assert len(found) < 10
    post("ger multi")
    follow(form)
    assert form.focused.answer == BURGER
    post(pygame.K_RETURN)
    follow(form)
    assert form.result == BURGER


def test_titles_that_are_what_was_typed_come_first(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/01_chicken_burger").form
    post("LETTUCE  burger")
    follow(form)
    titles = [row.told().title for row in form.rows if isinstance(row, PickerEntry)]
    exact = [title for title in titles if title.partition(" ")[2] == "Lettuce burger"]
    assert exact == titles[:1]
    assert len(titles) > 3
    assert form.focused is next(row for row in form.rows if isinstance(row, PickerEntry))


def test_each_family_has_one_heading_whatever_is_typed(display: Display) -> None:
    form = TaskPicker(Settings(), BURGER).form
    post("lettuce burger")
    follow(form)
    headings = [row.label for row in form.rows if isinstance(row, Words)]
    assert "Multi agent" in headings
    assert len(set(headings)) == len(headings)


def test_what_is_typed_is_erased_and_escape_forgets_it_first(display: Display) -> None:
    form = TaskPicker(Settings(), BURGER).form
    post("soup zz")
    follow(form)
    assert form.focused is form.rows[-1], "nothing is found: only the way back"
    post(pygame.K_BACKSPACE, pygame.K_BACKSPACE)
    follow(form)
    assert form.typed == "soup "
    post(pygame.K_ESCAPE)
    follow(form)
    assert (form.typed, form.result) == ("", None)
    assert sum(isinstance(row, PickerEntry) for row in form.rows) == len(task_names())
    post(pygame.K_ESCAPE)
    follow(form)
    assert form.result == "back"


def test_letters_that_mean_something_else_are_typed(display: Display) -> None:
    form = TaskPicker(Settings(), BURGER).form
    for letter in "we":
        key = pygame.key.key_code(letter)
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=letter))
        pygame.event.post(pygame.Event(pygame.TEXTINPUT, text=letter))
    follow(form)
    assert (form.typed, form.result) == ("we", None)


def test_families_by_the_sides_pages_ends_and_the_wheel(display: Display) -> None:
    form = TaskPicker(Settings(), "training/01_synchronous").form
    drawn(form, (800, 600))

    def at() -> object:
        assert form.focused is not None
        return form.focused.answer

    seen = []
    for _ in range(4):
        post(pygame.K_RIGHT)
        follow(form)
        seen.append(str(at()).partition("/")[0])
    assert seen[:3] == ["synchronous", "asynchronous", "multi_agent"]
    form.command(Command.LEFT)
    assert str(at()) == BURGER
    post(pygame.K_HOME)
    follow(form)
    assert at() == "training/01_synchronous"
    post(pygame.K_PAGEDOWN)
    follow(form)
    assert str(at()).startswith("synchronous/0")
    pygame.event.post(pygame.Event(pygame.MOUSEWHEEL, y=1))
    before = at()
    follow(form)
    assert at() != before
    post(pygame.K_END)
    follow(form)
    assert at() == "back"
    pygame.event.post(pygame.Event(pygame.MOUSEWHEEL, y=-1))
    follow(form)
    assert at() == "back", "the wheel does not go round"


def test_a_task_by_mouse(display: Display) -> None:
    form = TaskPicker(Settings(), "training/01_synchronous").form
    drawn(form, (800, 600))
    place, index = form._list.places[2]
    pos = place.center
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=1))
    follow(form)
    assert form.result == form.rows[index].answer


def test_pictures_and_lengths_come_when_nobody_types(
    display: Display, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = tuple(name for name in task_names() if name.startswith(("training/", BURGER)))
    monkeypatch.setattr(task_picker, "task_names", lambda: some)
    best = {f"{BURGER}@2": 44, f"{BURGER}@3": 40}
    form = TaskPicker(Settings(best=best), BURGER).form
    drawn(form, (800, 600))
    row = form.focused
    assert isinstance(row, PickerEntry)
    assert row.picture is not None
    assert row.picture((200, 200)) is None, "no key has to wait for it"
    assert row.told() == Told("01 Lettuce burger", "for 2 to 4 · done in 40")
    for _ in range(2 * len(some)):
        if row.picture((200, 200)) is not None:
            break
        form.idle()
    while form.idle():
        pass
    assert "steps · done in 40" in row.told().detail
    assert "Your best game took 40 steps." in row.about()


def test_the_task_that_is_looked_at_has_its_length_first(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/07_onion_soup").form
    row = form.focused
    assert isinstance(row, PickerEntry)
    drawn(form, (1280, 720))
    assert form.idle()
    assert "89 steps" in row.told().detail
    assert "A very good game takes 89 steps." in row.about()


def test_every_certified_task_comes_to_its_length(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/07_onion_soup").form
    certified = [
        name for name in task_names() if any(load_task(name).folder.glob("*.certificate.json"))
    ]
    while form.idle():
        pass
    told = {row.answer: row.told().detail for row in form.entries}
    assert [name for name in certified if "steps" not in told[name]] == []


def test_forty_quick_presses_are_forty(display: Display) -> None:
    form = PlayMenu(Settings(task="training/01")).form
    task = form.rows[1]
    assert isinstance(task, Choice)
    form.focus(task)
    for _ in range(len(task.options) + 3):
        post(pygame.K_RIGHT)
    began = time.perf_counter()
    follow(form)
    assert task.index == 3
    assert time.perf_counter() - began < 2.0, "no picture is drawn in between"


async def test_who_plays_alone_is_not_asked_about_partners() -> None:
    settings = Settings(task="synchronous/01")
    asking = PlayMenu(settings)
    answers: list[Callable[[Form], object]] = []
    seen: list[list[str]] = []

    async def ask(form: Form) -> object:
        seen.append([row.label for row in form.rows])
        return answers.pop(0)(form)

    answers += [lambda form: "task", lambda form: BURGER, lambda form: "start"]
    setup = await asking.ask(ask)
    assert setup is not None
    assert (setup.task, setup.seats) == (BURGER, 2)
    assert settings.task == BURGER
    assert "Partners" not in seen[0]
    assert "Players" not in seen[0]
    assert {"Partners", "Players"} <= set(seen[2])


def random_partners(
    start: State, kind: str, seed: int, players: Sequence[str], words: Language
) -> PromptPartners:
    """Bots that need not search for a plan first."""
    return PromptPartners({player: RandomPolicy(player, seed) for player in players})


def test_the_picture_marks_which_player_is_you(display: Display) -> None:
    """It is the one that is played, each time."""
    menu = PlayMenu(Settings(task=BURGER, seats=2))
    assert menu.form.picture is not None
    assert menu.form.picture((300, 200)) is None
    assert menu.form.idle()
    picture = menu.form.picture((300, 200))
    unmarked = Thumbnails()
    unmarked.at(BURGER, (300, 200))
    unmarked.load()
    other = unmarked.at(BURGER, (300, 200))
    assert picture is not None
    assert other is not None
    assert picture.get_size() == other.get_size()
    assert pygame.image.tobytes(picture, "RGB") != pygame.image.tobytes(other, "RGB")
    games = [LocalGame(menu.setup, "ada", time.monotonic, None, random_partners) for _ in "12"]
    seat = seat_out_of_the_way(games[0].world.initial)
    assert [game.source.view().me for game in games] == [seat, seat]


def test_titles_say_what_a_task_is() -> None:
    assert task_title(BURGER) == "Multi agent 01: lettuce burger"
    assert task_title(f"{BURGER}/free-42") == "Multi agent 01: lettuce burger, free-42"
    assert task_title("kitchen") == "Kitchen"
    assert "sandwich" in task_title("training/01_synchronous")
    assert dish_title("training/01_synchronous", "Make it.") == "Make it"
    assert dish_title(BURGER, "Make it.") == "Lettuce burger"


# Recordings


NOW = datetime(2026, 11, 22, 14, 5, tzinfo=UTC)


@pytest.mark.parametrize(
    ("ago", "words"),
    [
        (timedelta(0), "today 14:05"),
        (timedelta(hours=14), "today 0:05"),
        (timedelta(hours=15), "yesterday 23:05"),
        (timedelta(days=3), "19 Nov 14:05"),
        (timedelta(days=400), "18 Oct 2025"),
    ],
)
def test_when_a_game_was(ago: timedelta, words: str) -> None:
    assert when_words(NOW - ago, NOW) == words


def test_recordings_are_told_by_their_task_and_result(
    display: Display, tmp_path: Path, recording: bytes
) -> None:
    whole = tmp_path / "20261122T120000Z_a.rbt"
    whole.write_bytes(recording)
    damaged = {
        "cut.rbt": recording[: len(recording) // 2], "none.rbt": b"", "text.rbt": b"Hello",
        "version.rbt": b"RBTL\x63" + bytes(40), "noise.rbt": recording[:60] + os.urandom(300),
    }  # fmt: skip
    for name, content in damaged.items():
        (tmp_path / name).write_bytes(content)
    paths = [whole, *(tmp_path / name for name in damaged), tmp_path / "gone.rbt"]
    menu = ReplaysMenu(paths)
    while menu.form.idle():
        drawn(menu.form, (800, 600))
    told = {entry.answer: entry.told() for entry in menu.form.entries}
    title, detail = told[whole]
    assert title == "Synchronous 01: cheese sandwich"
    assert "won in 8 steps" in detail
    assert "With robot1-bot." in next(e for e in menu.form.entries if e.answer == whole).about()
    assert "damaged" in told[tmp_path / "cut.rbt"].detail
    assert "not a recording" in told[tmp_path / "text.rbt"].detail
    assert "format version 99" in told[tmp_path / "version.rbt"].detail
    for name in ("none.rbt", "noise.rbt"):
        assert told[tmp_path / name].detail
    assert "No such file" in told[tmp_path / "gone.rbt"].detail
    post("cheese won")
    follow(menu.form)
    assert menu.form.focused is not None
    assert menu.form.focused.answer == whole


def test_games_that_were_cut_off_are_listed_and_those_under_way_are_not(
    display: Display, tmp_path: Path, recording: bytes
) -> None:
    ages = {"whole.rbt": 5.0, "cut.rbt.part": 600.0, "now.rbt.part": 2.0, "both.rbt.part": 900.0,
            "both.rbt": 700.0, "draft.rbt.tmp": 800.0}  # fmt: skip
    for name, ago in ages.items():
        (tmp_path / name).write_bytes(recording)
        os.utime(tmp_path / name, (time.time() - ago,) * 2)
    stream, _ = plain(recording, 1 << 20)
    (tmp_path / "cut.rbt.part").write_bytes(stream[: [*frame_ends(stream)][-3]])
    os.utime(tmp_path / "cut.rbt.part", (time.time() - 600.0,) * 2)
    paths = recent_recordings([tmp_path, tmp_path / "none"])
    assert [path.name for path in paths] == ["whole.rbt", "cut.rbt.part", "both.rbt"]
    menu = ReplaysMenu(paths)
    assert menu.form.entries[1].told().title == "cut"
    while menu.form.idle():
        drawn(menu.form, (800, 600))
    assert "not played to its end" in menu.form.entries[1].told().detail


def test_what_is_no_file_is_no_recording(tmp_path: Path) -> None:
    """A pipe has no other end, a device has no end at all."""
    os.mkfifo(tmp_path / "pipe.rbt")
    (tmp_path / "folder.rbt").mkdir()
    (tmp_path / "zero.rbt").symlink_to("/dev/zero")
    (tmp_path / "circle.rbt").symlink_to(tmp_path / "circle.rbt")
    (tmp_path / "gone.rbt").symlink_to(tmp_path / "nothing")
    assert recent_recordings([tmp_path]) == []
    for name in ("pipe", "zero"):
        assert summary_of(tmp_path / f"{name}.rbt").fault == "no file"


def test_times_beyond_all_calendars(
    tmp_path: Path, recording: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.rbt"
    path.write_bytes(recording)
    told = path.stat()
    monkeypatch.setattr(Path, "stat", lambda *_, **__: os.stat_result((*told[:8], 10**15, 10**15)))
    assert summary_of(path).result
    west, east = timezone(timedelta(hours=-12)), timezone(timedelta(hours=12))
    assert when_words(datetime.min.replace(tzinfo=UTC), NOW.astimezone(west))
    assert when_words(datetime.max.replace(tzinfo=UTC), NOW.astimezone(east))


def test_fifty_recordings_are_read_at_once(tmp_path: Path, recording: bytes) -> None:
    paths = [tmp_path / f"{n}.rbt" for n in range(50)]
    for path in paths:
        path.write_bytes(recording)
    began = time.process_time()
    assert all(summary_of(path).steps == 8 for path in paths)
    assert time.process_time() - began < 1.0, "0.3 s on a machine of one's own"


@pytest.fixture(scope="module")
def recording() -> bytes:
    return proven_game()


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


def drawn(form: Form, size: tuple[int, int], scale: float = 1.0) -> pygame.Surface:
    surface = pygame.Surface(size)
    height = text_size(size, scale)
    area = surface.get_rect().inflate(-height, -height)
    form.draw(surface, area, typesetter(), height)
    return surface


@cache
def typesetter() -> Typesetter:
    """One for all forms: fonts are loaded once."""
    return Typesetter()


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
            place = next(p for p, index in form._list.places if form.rows[index] is row)
            assert inside.contains(place), (name, row.label)
            look_height = row_height(row, place.width, size, scale)
            assert place.height == look_height, (name, row.label, "is cut off")
            assert form._list.places, name
            form.command(Command.DOWN)
        assert form.focused is rows[0] or name in ("menu", "tasks"), "round and round"


def row_height(row: Row, width: int, size: tuple[int, int], scale: float) -> int:
    return row.height(Look(typesetter(), text_size(size, scale), focused=False), width)


def test_a_long_list_has_a_mark_that_can_be_dragged(display: Display) -> None:
    form = Form("Title", [Button(str(n), n) for n in range(40)], pinned=1)
    drawn(form, (400, 300))
    bar = form._list.bar
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
    assert not few._list.bar.width


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
