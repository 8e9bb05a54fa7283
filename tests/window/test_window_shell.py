"""The game around the games, from the menu to the end card, by posted events."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pygame
import pytest
from tests.support.evening import Evening, keys_of, wait
from tests.support.own_renderings import own_renderings
from tests.support.servers import serving
from tests.support.virtual_time import run
from tests.support.window_play import Script, post

from robotouille import World, load_task
from robotouille.certification.certificate import load_certificate
from robotouille.episode.rules import Clock
from robotouille.protocol.messages import Create
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.widgets import Choice
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.shell.games.local_game import GameSetup
from robotouille_client.window.shell.games.tutorial import TUTORIAL, TutorialSource, kind_of
from robotouille_client.window.shell.screens.saving_form import SavingForm
from robotouille_client.window.shell.screens.settings_menu import SettingsMenu
from robotouille_client.window.shell.settings import (
    Settings,
    SettingsFile,
    load_settings,
    save_settings,
    settings_path,
)
from robotouille_client.window.shell.shell import Shell
from robotouille_client.window.shell.starting import open_shell
from robotouille_client.window.shell.user_interface import UserInterface

SMALL = GameSetup("synchronous/01", clock=Clock.TURN, max_steps=100)


@pytest.fixture
def evening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Evening:
    found = Evening(tmp_path)
    found.watch(monkeypatch)
    return found


async def test_a_game_its_end_its_replay_again_and_quit(evening: Evening) -> None:
    def script() -> Iterator[None]:
        yield from keys_of(SMALL)
        assert evening.titles == ["Done!"]
        assert evening.form is not None
        words = [row.label for row in evening.form.rows]
        assert words[0].startswith("Goal reached in ")
        assert words[1] == "Proven best: 8 steps."
        assert words[-6:] == [
            "Play again", "Next task", "Watch the replay", "Save a video", "Menu", "Quit",
        ]  # fmt: skip
        assert any(word.endswith("(you)") for word in words)
        post(pygame.K_e, pygame.K_RETURN)
        yield from wait(2)
        assert evening.titles == ["Done!"], "who still plays does not answer the card"
        for _ in range(4):
            yield from wait(24)
            post(pygame.K_e)
        yield from wait(3)
        assert evening.titles == ["Done!"], "nor does who goes on for a while"
        yield from wait(60)
        yield from evening.choose("Watch the replay")
        yield from wait(5)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        yield from evening.choose("Leave the replay")
        yield from evening.choose("Play again")
        yield from wait(3)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        assert evening.titles[-1] == "Leave this game?"
        yield from evening.choose("Leave it")
        assert evening.titles[-1] == "Hello, player"
        yield from evening.choose("Quit")
        yield from wait(100)
        raise AssertionError("it goes on after Quit")

    await asyncio.wait_for(evening.go(script, SMALL), 60)
    assert not evening.fingers.ended
    (path,) = (evening.folder / "recordings").iterdir()
    recording = read_recording(path)
    assert recording.verify().ok
    assert recording.outcome is not None
    assert recording.outcome["reason"] == "goal"


@pytest.mark.parametrize("chosen", ["Watch the replay", "Save a video"])
async def test_the_end_card_looks_as_before_when_one_comes_back_to_it(
    evening: Evening, chosen: str
) -> None:
    """Beside the kitchen, with the focus on what was chosen."""
    if chosen == "Save a video":
        pytest.importorskip("av")

    def looks() -> bytes:
        surface = pygame.display.get_surface()
        assert surface is not None
        return pygame.image.tobytes(surface, "RGB")

    def script() -> Iterator[None]:
        yield from keys_of(SMALL)
        yield from wait(300)
        assert evening.window is not None
        card = evening.window.card
        assert card is not None
        card.focus(next(row for row in card.rows if row.label == chosen))
        yield from wait(1)
        post(pygame.K_F11, pygame.K_F11)  # The whole window is drawn anew.
        yield from wait(3)
        before = looks()
        post(pygame.K_RETURN)
        yield from wait(10)
        post(pygame.K_ESCAPE)
        yield from wait(3)
        if chosen == "Watch the replay":
            yield from evening.choose("Leave the replay")
        assert evening.window.card is not card
        assert evening.window.card is not None
        assert evening.window.card.message == ("No video was saved." if "video" in chosen else "")
        evening.window.card.message = ""
        yield from wait(3)
        assert looks() == before
        yield from evening.choose("Quit")
        yield from wait(100)

    await asyncio.wait_for(evening.go(script, SMALL), 60)
    assert not evening.fingers.ended


async def test_a_video_is_saved_or_given_up(evening: Evening) -> None:
    pytest.importorskip("av")

    def videos() -> list[Path]:
        return list((evening.folder / "recordings").glob("*.mp4"))

    def script() -> Iterator[None]:
        for _ in range(4):
            post(pygame.K_SPACE)
            yield from wait(2)
        yield from wait(60)
        yield from evening.choose("Save a video")
        assert evening.form is not None
        assert isinstance(evening.form, SavingForm)
        before = evening.form.percent
        yield from wait(20)
        assert before < evening.form.percent < 100
        post(pygame.K_ESCAPE)
        yield from wait(3)
        assert evening.form.message == "No video was saved."
        assert not videos()
        yield from evening.choose("Save a video")
        while evening.titles[-1] != "Not done this time":
            yield
        (video,) = videos()
        assert evening.form.message == f"The video is saved: {video}"
        post(pygame.K_ESCAPE)
        yield from wait(3)
        yield from evening.choose("Quit")
        yield from wait(100)

    short = GameSetup("synchronous/01", clock=Clock.TURN, max_steps=3)
    await asyncio.wait_for(evening.go(script, short), 60)
    assert not evening.fingers.ended


async def test_a_game_that_is_closed_at_its_end_is_kept(evening: Evening) -> None:
    await asyncio.wait_for(evening.go(lambda: keys_of(SMALL), SMALL), 60)
    assert evening.fingers.ended
    (path,) = (evening.folder / "recordings").iterdir()
    assert read_recording(path).verify().ok


async def test_losing_does_not_look_like_winning(evening: Evening) -> None:
    def script() -> Iterator[None]:
        for _ in range(4):
            post(pygame.K_SPACE)
            yield from wait(2)
        assert evening.titles == ["Not done this time"]
        yield from wait(60)
        post(pygame.K_ESCAPE)
        yield from wait(3)
        assert evening.titles[-1] == "Hello, player"
        post(pygame.K_ESCAPE)
        yield from wait(2)
        assert evening.titles[-1] == "Leave Robotouille?"
        yield from evening.choose("Quit")
        yield from wait(100)

    short = GameSetup("synchronous/01", clock=Clock.TURN, max_steps=3)
    await asyncio.wait_for(evening.go(script, short), 60)
    assert not evening.fingers.ended, "Escape quits"


async def test_play_from_the_menu_with_another_task_and_next(evening: Evening) -> None:
    def script() -> Iterator[None]:
        yield
        yield from evening.choose("Play here")
        post(pygame.K_DOWN)
        yield
        task = evening.shell.settings.task
        post(pygame.K_RIGHT)
        yield
        yield from evening.choose("Start")
        assert evening.window is not None
        assert evening.shell.settings.task != task
        post(pygame.K_ESCAPE)
        yield from wait(2)
        yield from evening.choose("Quit")

    await asyncio.wait_for(evening.go(script), 60)
    kept, words = load_settings(evening.folder / "window.json")
    assert not words
    assert kept.task.startswith("synchronous/02")
    assert not list((evening.folder / "recordings").glob("*")), "a game that was left is not kept"


def test_the_best_game_of_a_task_is_remembered(evening: Evening) -> None:
    best = evening.shell.settings.best
    for timing, reason, steps in [
        ("benchmark", "goal", 8), ("people", "step_limit", 9), ("people", "goal", 40),
        ("people", "goal", 60), ("people", "goal", 30),
    ]:  # fmt: skip
        world = World(load_task("synchronous/01", timing=timing))
        source = SimpleNamespace(outcome={"reason": reason, "steps": steps})
        evening.shell.local._note_best(SimpleNamespace(world=world, source=source))  # type: ignore[arg-type]
    assert best == {"synchronous/01_cheese_sandwich@1": 30}
    assert remembered(evening).best == best


def remembered(evening: Evening) -> Settings:
    """What would be known if the process were killed now."""
    return load_settings(evening.folder / "window.json")[0]


async def test_settings_are_kept_and_followed(evening: Evening) -> None:
    def script() -> Iterator[None]:
        yield
        yield from evening.choose("Settings")
        for _ in "player":
            post(pygame.K_BACKSPACE)
        post("Ada e")
        yield
        assert remembered(evening).preferences.name == "Ada e"
        yield from evening.choose("Keys")
        post(pygame.K_UP, pygame.K_DOWN, pygame.K_DOWN, pygame.K_DOWN, pygame.K_DOWN, pygame.K_DOWN)
        yield
        assert evening.form is not None
        assert evening.form.focused is not None
        yield from evening.choose("Use what is here")
        post(pygame.K_f)
        yield from wait(2)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        assert evening.titles[-1] == "Settings", "one back, not two"
        post(pygame.K_ESCAPE)
        yield from wait(2)
        assert evening.form.title == "Hello, Ada e"
        yield from evening.choose("Quit")

    await asyncio.wait_for(evening.go(script), 60)
    kept, _ = load_settings(evening.folder / "window.json")
    assert (kept.preferences.name, kept.preferences.keys) == ("Ada e", {"use": ["f"]})


async def test_the_tutorial_ends_with_its_task(evening: Evening) -> None:
    def script() -> Iterator[None]:
        yield
        yield from evening.choose("Tutorial: two minutes")
        yield from wait(10)
        yield from keys_of(TUTORIAL)
        assert evening.titles[-1] == "Done!"
        assert remembered(evening).learned
        yield from wait(60)
        yield from evening.choose("Menu")
        yield from evening.choose("Quit")

    evening.shell.settings.learned = False
    await asyncio.wait_for(evening.go(script), 60)
    assert evening.shell.settings.learned


def test_the_tutorial_waits_until_each_thing_is_done() -> None:
    script = Script(World("training/01"))
    source = TutorialSource(script, KeyMap())
    told = [source.view().lesson]
    for line in load_certificate("training/01").plan or ():
        source.act(script.world.parse(script.state, script.me, line))
        if source.view().lesson != told[-1]:
            told.append(source.view().lesson)
            if source.lesson is not None:
                before = source.lesson
                source.act(script.world.parse(script.state, script.me, "wait()"))
                assert source.lesson is before, "to wait teaches nothing"
    assert [words.split(":")[0] for words in told] == [
        "Walk to another place",
        "Walk to something that lies there and take it",
        "Carry it somewhere else and put it down",
        "Some places are for work",
        "Now the whole task",
    ]


def test_to_put_a_thing_back_where_it_was_is_not_to_carry_it_somewhere_else() -> None:
    script = Script(World("training/01"))
    source = TutorialSource(script, KeyMap())
    kinds = []
    for line in load_certificate("training/01").plan or ():
        action = script.world.parse(script.state, script.me, line)
        taken = kind_of(script.state, action) == "take"
        source.act(action)
        kinds.append(source.lesson and source.lesson.kind)
        if taken:
            break
    assert kinds[-1] == "put"
    for kind in ("put", "take"):
        back = [a for a in script.state.actions(script.me) if kind_of(script.state, a) == kind]
        source.act(back[0])
        assert source.lesson is not None
        assert source.lesson.kind == "put", "it lies where it was"


def test_work_is_learned_when_it_is_done_and_the_lesson_says_what_to_bring() -> None:
    script = Script(World("training/01"))
    source = TutorialSource(script, KeyMap())
    seen = []
    for line in load_certificate("training/01").plan or ():
        action = script.world.parse(script.state, script.me, line)
        source.act(action)
        if action.name == "cut":
            seen.append(source.view().lesson)
    assert len(seen) == 3
    assert all("take the tomato to the board" in words for words in seen[:2])
    assert seen[2].startswith("Now the whole task")


async def test_a_window_can_be_closed_anywhere(evening: Evening) -> None:
    for first in (None, SMALL):
        await asyncio.wait_for(evening.go(lambda: wait(3), first), 30)
        assert evening.fingers.ended


async def test_a_task_that_is_none_is_told_in_the_menu(evening: Evening) -> None:
    evening.shell.settings.task = "no/such"

    def script() -> Iterator[None]:
        yield
        yield from evening.choose("Join by code")
        yield from evening.choose("Play")
        yield from wait(400)
        assert evening.form is not None
        assert evening.form.message, "nobody listens there"
        post(pygame.K_ESCAPE)
        yield from wait(3)
        yield from evening.choose("Quit")

    evening.shell.settings.prefer(server="ws://127.0.0.1:9")
    await asyncio.wait_for(evening.go(script), 60)


def test_open_a_kitchen_on_a_server_wait_for_others_and_leave(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evening = Evening(tmp_path)
    evening.watch(monkeypatch)

    async def main() -> None:
        async with serving(tmp_path / "server") as server:
            evening.shell.settings.prefer(server=server.url)
            evening.shell.settings.task = "multi_agent/01"

            def script() -> Iterator[None]:
                yield
                yield from evening.choose("Open a kitchen on a server")
                yield from evening.choose("Open and join")
                while evening.window is None:
                    yield
                yield from wait(5)
                post(pygame.K_ESCAPE)
                yield from wait(2)
                yield from evening.choose("Leave it")
                yield from evening.choose("Kitchens on a server")
                while evening.titles[-1] != "Kitchens":
                    yield
                assert evening.form is not None
                assert "lettuce burger" in evening.form.rows[0].label
                yield from evening.choose("Back")
                yield from evening.choose("Quit")

            monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
            evening.shell.ui.clock = asyncio.get_running_loop().time
            evening.fingers.timer.sleep = asyncio.sleep  # type: ignore[method-assign]
            await asyncio.wait_for(evening.go(script), 60)
            assert evening.shell.settings.code
            async with connect(server.url, name="bob") as bob:
                (found,) = await bob.episodes()
                assert found.code == evening.shell.settings.code

    run(main())


@pytest.mark.parametrize("leaves", [True, False])
def test_without_a_menu_the_window_closes_after_the_game(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, leaves: bool
) -> None:
    evening = Evening(tmp_path, menu=False)
    evening.watch(monkeypatch)

    async def main() -> None:
        async with serving(tmp_path / "server") as server:
            room = server.lobby.create(Create(task="multi_agent/02"))

            def script() -> Iterator[None]:
                while evening.window is None:
                    yield
                yield from wait(5)
                if leaves:
                    post(pygame.K_ESCAPE)
                    yield from wait(2)
                    assert evening.form is not None
                    assert [row.label for row in evening.form.rows] == ["Go on", "Leave it"]
                    yield from evening.choose("Leave it")
                else:
                    room.abort("enough")
                    yield from wait(60)
                    assert evening.form is not None
                    assert "Menu" not in [row.label for row in evening.form.rows]
                    yield from evening.choose("Close")
                yield from wait(20)
                raise AssertionError("it is still open")

            monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
            evening.shell.ui.clock = asyncio.get_running_loop().time
            evening.fingers.timer.sleep = asyncio.sleep  # type: ignore[method-assign]
            evening.fingers.script = script()
            joined = evening.shell.remote.join(room.code, url=server.url)
            await asyncio.wait_for(evening.shell.run(joined), 60)

    run(main())


@pytest.mark.parametrize("file", ["a\0b", "/dev/zero", "pipe"])
def test_words_that_are_no_file_are_told(tmp_path: Path, file: str) -> None:
    if file == "pipe":
        file = str(tmp_path / file)
        os.mkfifo(file)
    ui = UserInterface(Settings(language_file=file), Display((320, 240), headless=True))
    assert "No words of your own" in ui.words_fault


def test_a_look_that_is_gone_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr("robotouille_client.window.shell.starting.require_screen", lambda: None)
    assert not save_settings(Settings(rendering="marble"), settings_path())
    shell = open_shell()
    try:
        assert shell.ui.preferences.rendering == ""
        assert "'marble'" in shell.ui.message
    finally:
        shell.ui.close()


@pytest.fixture
def renderings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return own_renderings(tmp_path, monkeypatch)


async def test_what_is_missing_in_a_look_is_told_when_it_is_chosen(
    evening: Evening, renderings: Path
) -> None:
    shell = evening.shell
    whole = {"extends": "robotouille", "progress": {"cook": "icon_flame.svg"}}
    lacking = {"extends": "robotouille", "progress": {"cokk": "icon_flame.svg"}}
    for name, look in (("whole", whole), ("lacking", lacking), ("broken", {"flor": 1})):
        (renderings / f"{name}.json").write_text(json.dumps(look))
    menu = SettingsMenu(shell.settings, shell._follow)
    row = next(row for row in menu.form.rows if row.label == "Look")
    told = {}
    assert isinstance(row, Choice)
    for _ in range(4):
        row.command(Command.USE)
        told[row.value] = (menu.form.message, shell.ui.preferences.rendering)
    said, kept = told["broken"]
    assert said.startswith("'broken' cannot be used, kitchens look as usual: flor: unknown field")
    assert kept == ""
    assert told["chalk"] == ("What you change counts at once.", "chalk")
    assert told["whole"] == ("What you change counts at once.", "whole")
    said, kept = told["lacking"]
    assert "'lacking' is not whole" in said
    assert "no action 'cokk'; did you mean 'cook'?" in said
    assert kept == "lacking"


def test_what_is_missing_in_a_remembered_look_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, renderings: Path
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr("robotouille_client.window.shell.starting.require_screen", lambda: None)
    (renderings / "mine.json").write_text('{"extends": "robotouille", "icons": {"app": "no.svg"}}')
    assert not save_settings(Settings(rendering="mine"), settings_path())
    shell = open_shell()
    try:
        assert shell.ui.preferences.rendering == "mine"
        assert "there is no picture 'no.svg'" in shell.ui.message
    finally:
        shell.ui.close()


def test_a_size_that_is_asked_for_comes_before_a_window_that_fills_the_screen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For this time: what was saved stays."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr("robotouille_client.window.shell.starting.require_screen", lambda: None)
    assert not save_settings(Settings(fullscreen=True), settings_path())
    shell = open_shell(size="640x480")
    try:
        assert (shell.ui.display.size, shell.ui.display.fullscreen) == ((640, 480), False)
        shell.ui.remember()
        assert load_settings(settings_path())[0].preferences.fullscreen
    finally:
        shell.ui.close()


async def test_settings_that_cannot_be_saved_are_no_reason_to_stop(evening: Evening) -> None:
    (evening.folder / "file").write_text("")
    path = evening.folder / "file" / "window.json"
    evening.shell.ui.file = SettingsFile(path, evening.shell.settings)
    await asyncio.wait_for(evening.go(lambda: wait(2)), 30)
    assert "cannot be saved" in evening.shell.ui.message


@pytest.mark.parametrize("renamed", [False, True])
async def test_what_is_said_for_one_time_is_not_kept(tmp_path: Path, renamed: bool) -> None:
    path = tmp_path / "settings.json"
    remembered = Preferences(name="ada", size=(1280, 720))
    display = Display((640, 360), headless=True)
    now = remembered.model_copy(update={"name": "guest", "size": (640, 360)})
    shell = Shell(Settings(preferences=now), display, path=path, remembered=remembered)

    async def first() -> object:
        if renamed:
            shell.settings.prefer(name="grace")
        return "quit"

    await shell.run(first())
    kept, _ = load_settings(path)
    assert kept.preferences.size == (1280, 720)
    assert kept.preferences.name == ("grace" if renamed else "ada")
