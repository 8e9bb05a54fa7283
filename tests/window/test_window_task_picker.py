"""Lists of tasks and recordings, and the menu for a local game."""

from __future__ import annotations

import os
import time
from collections import OrderedDict
from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pygame
import pytest
from tests.support.forms import drawn
from tests.support.golden_screens import proven_game
from tests.support.window_play import follow, post

from robotouille.domain.loading import task_names
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille.replay.compression import plain
from robotouille.replay.container import frame_ends
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.app import play_menu as task_picker
from robotouille_client.window.app import thumbnails
from robotouille_client.window.app.local_game import LocalGame
from robotouille_client.window.app.play_menu import PlayMenu, TaskPicker
from robotouille_client.window.app.replays_menu import (
    ReplaysMenu,
    recent_recordings,
    summary_of,
    when_words,
)
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.app.thumbnails import Thumbnails
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.picker import EntryText, PickerEntry
from robotouille_client.window.forms.screen import Display
from robotouille_client.window.forms.widgets import Words
from robotouille_client.window.input.commands import Command
from robotouille_client.window.sources.texts import dish_title, task_heading, task_title

BURGER = "multi_agent/01_lettuce_burger"


@pytest.fixture(autouse=True)
def empty_picture_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clear the cache of pictures, which lasts as long as the process."""
    monkeypatch.setattr(thumbnails, "_kitchens", OrderedDict())


def test_find_a_task_by_typing(display: Display) -> None:
    form = TaskPicker(Settings(), "synchronous/01_cheese_sandwich").form
    assert len(form.entries) == len(task_names())
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


@pytest.mark.parametrize("typed", ["07", "7"])
def test_a_number_finds_the_tasks_with_it(typed: str) -> None:
    entry = PickerEntry(
        "soup", lambda: EntryText("07 Onion soup", "1 player"), about=lambda: "Not played yet."
    )
    shift = PickerEntry(
        "rush", lambda: EntryText("06 Rush hour", "2 to 4 players"), about=lambda: "157, 207, 257."
    )
    assert entry.matches(typed)
    assert not shift.matches(typed)


def test_a_family_is_found_by_the_name_of_its_folder(display: Display) -> None:
    form = TaskPicker(Settings(), BURGER).form
    post("multi agent 01")
    follow(form)
    assert [row.answer for row in form.rows if isinstance(row, PickerEntry)][:1] == [BURGER]


def test_exact_titles_come_first_and_each_family_has_one_heading(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/01_chicken_burger").form
    post("LETTUCE  burger")
    follow(form)
    entries = [row for row in form.rows if isinstance(row, PickerEntry)]
    titles = [row.text().title for row in entries]
    exact = [title for title in titles if title.partition(" ")[2] == "Lettuce burger"]
    assert exact == titles[:1]
    assert len(titles) > 3
    assert form.focused is entries[0]
    headings = [row.label for row in form.rows if isinstance(row, Words)]
    assert "Together" in headings
    assert len(set(headings)) == len(headings)


def test_escape_clears_the_search_first(display: Display) -> None:
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


def test_scroll_by_family_page_end_and_wheel(display: Display) -> None:
    form = TaskPicker(Settings(), "training/01_synchronous").form
    drawn(form, (800, 600))

    def at() -> object:
        return form.focused.answer

    seen = []
    for _ in range(5):
        post(pygame.K_RIGHT)
        follow(form)
        seen.append(str(at()).partition("/")[0])
    assert seen[:4] == ["shifts", "synchronous", "asynchronous", "multi_agent"]
    form.command(Command.LEFT)
    assert str(at()) == BURGER
    post(pygame.K_HOME)
    follow(form)
    assert at() == "training/01_synchronous"
    post(pygame.K_PAGEDOWN)
    follow(form)
    assert str(at()).startswith(("shifts/0", "synchronous/0"))
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


def test_pictures_and_lengths_load_while_idle(
    display: Display, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = tuple(name for name in task_names() if name.startswith(("training/", BURGER)))
    monkeypatch.setattr(task_picker, "task_names", lambda: some)
    best = {f"{BURGER}@2": 44, f"{BURGER}@3": 40}
    form = TaskPicker(Settings(best=best), BURGER).form
    drawn(form, (800, 600))
    row = form.focused
    assert isinstance(row, PickerEntry)
    assert row.picture((200, 200)) is None, "no key has to wait for it"
    assert row.text() == EntryText("01 Lettuce burger", "2 to 4 players · your best 40")
    for _ in range(2 * len(some)):
        if row.picture((200, 200)) is not None:
            break
        form.idle()
    while form.idle():
        pass
    assert "steps · your best 40" in row.text().detail
    assert "Your best: 40 steps." in row.about()


@pytest.mark.slow
def test_the_focused_task_loads_first(display: Display) -> None:
    form = TaskPicker(Settings(), "asynchronous/07_onion_soup").form
    row = form.focused
    assert isinstance(row, PickerEntry)
    drawn(form, (1280, 720))
    assert form.idle()
    assert row.picture((200, 200)) is not None, "no list stays blank while lengths are computed"
    assert "steps" not in row.text().detail
    for _ in range(len(form.rows)):
        if "3 stars: 228 steps" in row.text().detail:
            break
        form.idle()
    assert "Three stars need at most 228 steps. Best known: 89." in row.about()


async def test_one_player_has_no_choice_of_bots() -> None:
    settings = Settings(task="synchronous/01")
    asking = PlayMenu(settings)
    answers: list[Callable[[Form], object]] = []
    seen: list[list[str]] = []

    async def ask(form: Form) -> object:
        seen.append([row.label for row in form.rows])
        return answers.pop(0)(form)

    answers += [lambda form: "task", lambda form: BURGER, lambda form: "start"]
    setup = await asking.ask(ask)
    assert (setup.task, setup.seats) == (BURGER, 2)
    assert settings.task == BURGER
    assert "Bots" not in seen[0]
    assert "Players" not in seen[0]
    assert {"Bots", "Players"} <= set(seen[2])


@pytest.mark.slow
def test_the_picture_marks_the_own_player(display: Display) -> None:
    menu = PlayMenu(Settings(task=BURGER, seats=2))
    assert menu.form.picture((300, 200)) is None
    assert menu.form.idle()
    picture = menu.form.picture((300, 200))
    unmarked = Thumbnails()
    unmarked.at(BURGER, (300, 200))
    unmarked.load()
    other = unmarked.at(BURGER, (300, 200))
    assert picture.get_size() == other.get_size()
    assert pygame.image.tobytes(picture, "RGB") != pygame.image.tobytes(other, "RGB")
    game = LocalGame(menu.setup, "ada", time.monotonic, None, prompt_partners)
    assert game.source.view().me == seat_out_of_the_way(game.world.initial)


def test_task_titles() -> None:
    assert task_title(BURGER) == "Together 01: lettuce burger"
    assert task_title(f"{BURGER}/free-42") == "Together 01: lettuce burger, free-42"
    assert task_heading(f"{BURGER}/free-42") == "together · 01 · free-42"
    assert task_heading("kitchen") == ""
    assert task_title("kitchen") == "Kitchen"
    assert "sandwich" in task_title("training/01_synchronous")
    assert dish_title("training/01_synchronous", "Make it.") == "Make it"
    assert dish_title(BURGER, "Make it.") == "Lettuce burger"


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
def test_when_words(ago: timedelta, words: str) -> None:
    assert when_words(NOW - ago, NOW) == words


def test_recordings_show_task_and_result(
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
    received = {entry.answer: entry.text() for entry in menu.form.entries}
    title, detail = received[whole]
    assert title == "Alone 01: cheese sandwich"
    assert "won in 8 steps" in detail
    assert (
        "Played by robot1-bot." in next(e for e in menu.form.entries if e.answer == whole).about()
    )
    assert "damaged" in received[tmp_path / "cut.rbt"].detail
    assert "not a recording" in received[tmp_path / "text.rbt"].detail
    assert "format version 99" in received[tmp_path / "version.rbt"].detail
    for name in ("none.rbt", "noise.rbt"):
        assert received[tmp_path / name].detail
    assert "No such file" in received[tmp_path / "gone.rbt"].detail
    post("cheese won")
    follow(menu.form)
    assert menu.form.focused.answer == whole


def test_interrupted_games_are_listed_and_running_ones_not(
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
    assert menu.form.entries[1].text().title == "cut"
    while menu.form.idle():
        drawn(menu.form, (800, 600))
    assert "unfinished" in menu.form.entries[1].text().detail


def test_only_files_are_listed(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.rbt")
    (tmp_path / "folder.rbt").mkdir()
    (tmp_path / "zero.rbt").symlink_to("/dev/zero")
    (tmp_path / "circle.rbt").symlink_to(tmp_path / "circle.rbt")
    (tmp_path / "gone.rbt").symlink_to(tmp_path / "nothing")
    assert recent_recordings([tmp_path]) == []
    for name in ("pipe", "zero"):
        assert summary_of(tmp_path / f"{name}.rbt").fault == "not a file"


def test_times_outside_the_calendar(
    tmp_path: Path, recording: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.rbt"
    path.write_bytes(recording)
    received = path.stat()
    monkeypatch.setattr(
        Path, "stat", lambda *_, **__: os.stat_result((*received[:8], 10**15, 10**15))
    )
    assert summary_of(path).result
    west, east = timezone(timedelta(hours=-12)), timezone(timedelta(hours=12))
    assert when_words(datetime.min.replace(tzinfo=UTC), NOW.astimezone(west))
    assert when_words(datetime.max.replace(tzinfo=UTC), NOW.astimezone(east))


@pytest.fixture(scope="module")
def recording() -> bytes:
    return proven_game()
