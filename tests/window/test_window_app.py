"""The app from the menu to the end card, in local games and on a server."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pygame
import pytest
from tests.support.own_renderings import own_renderings
from tests.support.samples import quick_sample
from tests.support.servers import serving
from tests.support.virtual_time import virtual
from tests.support.window_play import Script, post
from tests.support.window_session import WindowSession, keys_of, wait

from robotouille import World, load_task
from robotouille.certification.certificate import load_certificate
from robotouille.episode.rules import Clock
from robotouille.protocol.messages import Create
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_client.window import StartOptions, open_app
from robotouille_client.window.app.app import App
from robotouille_client.window.app.local_game import GameSetup
from robotouille_client.window.app.local_games import (
    EASY_RATE,
    PUT_BACK,
    TUTORIAL,
    TutorialSource,
    kind_of,
)
from robotouille_client.window.app.main_menu import SettingsMenu, main_menu
from robotouille_client.window.app.replays_menu import SavingForm
from robotouille_client.window.app.settings import (
    Settings,
    SettingsFile,
    load_settings,
    save_settings,
    settings_path,
)
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.widgets import Choice
from robotouille_client.window.input.commands import Command, KeyMap

SMALL = GameSetup("synchronous/01", clock=Clock.TURN, max_steps=100)
SHORT = GameSetup("synchronous/01", clock=Clock.TURN, max_steps=3)


@pytest.mark.slow
async def test_game_replay_again_and_quit(session: WindowSession) -> None:
    def script() -> Iterator[None]:
        yield from keys_of(SMALL)
        assert session.titles == ["Excellent!"]
        words = [row.label for row in session.form.rows]
        assert words[0].startswith("Goal reached in ")
        assert words[1] == "Three stars need at most 16 steps."
        assert words[2] == "Best possible: 8 steps."
        assert words[-6:] == [
            "Play again", "Next task", "Watch the replay", "Save a video", "Menu", "Quit",
        ]  # fmt: skip
        assert any(word.endswith("(you)") for word in words)
        post(pygame.K_e, pygame.K_RETURN)
        yield from wait(2)
        assert session.titles == ["Excellent!"], "who still plays does not answer the card"
        for _ in range(4):
            yield from wait(24)
            post(pygame.K_e)
        yield from wait(3)
        assert session.titles == ["Excellent!"], "nor does who goes on for a while"
        yield from wait(60)
        yield from session.choose("Watch the replay")
        yield from wait(5)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        yield from session.choose("Leave the replay")
        yield from session.choose("Play again")
        yield from wait(3)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        assert session.titles[-1] == "Leave this game?"
        yield from session.choose("Leave")
        assert session.titles[-1] == "Hello, player!"
        yield from session.choose("Quit")
        yield from wait(100)
        raise AssertionError("it goes on after Quit")

    await asyncio.wait_for(session.go(script, SMALL), 60)
    assert not session.user.ended
    (path,) = (session.folder / "recordings").iterdir()
    recording = read_recording(path)
    assert recording.verify().ok
    assert recording.outcome["reason"] == "goal"


@pytest.mark.slow
async def test_the_end_card_keeps_its_focus_after_the_replay(session: WindowSession) -> None:
    session.app.settings.prefer(reduced_motion=True)  # Nothing else changes in the pictures.

    def script() -> Iterator[None]:
        yield from lose()
        card = session.window.card
        card.focus(next(row for row in card.rows if row.label == "Watch the replay"))
        yield from wait(1)
        post(pygame.K_F11, pygame.K_F11)  # Draw the whole window again.
        yield from wait(3)
        before = pixels()
        post(pygame.K_RETURN)
        yield from wait(10)
        post(pygame.K_ESCAPE)
        yield from wait(3)
        yield from session.choose("Leave the replay")
        assert session.window.card is not card
        yield from wait(3)
        assert pixels() == before
        yield from session.choose("Quit")
        yield from wait(100)

    await asyncio.wait_for(session.go(script, SHORT), 60)
    assert not session.user.ended


def pixels() -> bytes:
    surface = pygame.display.get_surface()
    return pygame.image.tobytes(surface, "RGB")


def lose() -> Iterator[None]:
    """Play a game of three turns until its end card accepts keys."""
    for _ in range(4):
        post(pygame.K_SPACE)
        yield from wait(2)
    yield from wait(60)


@pytest.mark.parametrize(
    ("best", "won_before"),
    quick_sample(
        [({}, False), ({"shifts/01_sandwich_bar@1": 33}, False), ({"training/01@1": 50}, True)]
    ),
)
async def test_an_easy_pace_is_offered_after_a_lost_first_game(
    session: WindowSession, best: dict[str, int], won_before: bool
) -> None:
    session.app.settings.best = best
    setup = GameSetup("synchronous/01", max_steps=3, countdown=0.0)

    def script() -> Iterator[None]:
        yield from wait(2)
        yield from session.choose("Start")
        yield from wait(150)
        assert (session.labels[0] == "Play again at an easy pace") is not won_before
        if not won_before:
            yield from session.choose("Play again at an easy pace")
            assert session.app.settings.rate == EASY_RATE

    await asyncio.wait_for(session.go(script, setup), 60)


def test_the_tutorial_is_not_the_first_choice_once_it_is_finished() -> None:
    for learned, answer in ((False, MenuChoice.TUTORIAL), (True, MenuChoice.LEVELS)):
        form = main_menu(Settings(learned=learned), chosen=MenuChoice.TUTORIAL)
        assert form.focused is not None
        assert form.focused.answer == answer


@pytest.mark.slow
async def test_a_video_is_saved_or_cancelled(session: WindowSession) -> None:
    pytest.importorskip("av")

    def videos() -> list[Path]:
        return list((session.folder / "recordings").glob("*.mp4"))

    def script() -> Iterator[None]:
        yield from lose()
        yield from session.choose("Save a video")
        assert isinstance(session.form, SavingForm)
        before = session.form.percent
        yield from wait(20)
        assert before < session.form.percent < 100
        post(pygame.K_ESCAPE)
        yield from wait(3)
        assert session.form.message == "No video saved."
        assert not videos()
        yield from session.choose("Save a video")
        while session.titles[-1] != "Not this time":
            yield
        (video,) = videos()
        assert session.form.message == f"Video saved: {video}"
        post(pygame.K_ESCAPE)
        yield from wait(3)
        yield from session.choose("Quit")
        yield from wait(100)

    await asyncio.wait_for(session.go(script, SHORT), 60)
    assert not session.user.ended


@pytest.mark.slow
async def test_the_next_task_keeps_the_company(session: WindowSession) -> None:
    first = GameSetup("multi_agent/10", seats=3, clock=Clock.TURN, max_steps=1, partner="random")
    played: list[tuple[str, list[str]]] = []

    def play() -> Iterator[None]:
        view = session.source.view()
        played.append((view.world.task.name, [seat.kind for seat in view.seats]))
        while not view.outcome:
            post(pygame.K_SPACE if session.window.card is None else pygame.K_RETURN)
            yield from wait(3)
            view = session.source.view()

    def script() -> Iterator[None]:
        for _ in range(3):
            yield from play()
            yield from wait(90)
            yield from session.choose("Next task")

    await session.go(script, first)
    names = ("multi_agent/10", "shifts/01", "shifts/02")
    for (name, kinds), start, bots in zip(played, names, (2, 1, 2), strict=True):
        assert name.startswith(start)
        assert sorted(kinds) == [*["bot"] * bots, "human"], "as many as the task allows"


async def test_choose_a_task_and_continue_with_the_next(session: WindowSession) -> None:
    def script() -> Iterator[None]:
        yield
        yield from session.choose("Play here")
        post(pygame.K_DOWN)
        yield
        task = session.app.settings.task
        post(pygame.K_RIGHT)
        yield
        yield from session.choose("Start")
        assert session.window is not None
        assert session.app.settings.task != task
        yield from session.choose("Start")
        post(pygame.K_ESCAPE)
        yield from wait(2)
        yield from session.choose("Quit")

    await asyncio.wait_for(session.go(script), 60)
    kept, words = load_settings(session.folder / "window.json")
    assert not words
    assert kept.task.startswith("synchronous/02")
    assert not list((session.folder / "recordings").glob("*")), "a game that was left is not kept"


def test_the_best_result_is_saved(session: WindowSession) -> None:
    best = session.app.settings.best
    for timing, reason, steps, acted in [
        ("benchmark", "goal", 8, 8), ("people", "step_limit", 9, 9), ("people", "goal", 40, 9),
        ("people", "goal", 60, 9), ("people", "goal", 30, 9), ("people", "goal", 20, 0),
    ]:  # fmt: skip
        world = World(load_task("synchronous/01", timing=timing))
        seats = [{"player": "robot1", "acted": acted}]
        source = SimpleNamespace(outcome={"reason": reason, "steps": steps, "seats": seats})
        game = SimpleNamespace(
            world=world, source=source, step_seconds=0.2, people=world.players[:1]
        )
        session.app.local._note_best(game)
    assert best == {"synchronous/01_cheese_sandwich@1": 30}
    assert session.remembered.best == best
    assert session.remembered.stars == {"synchronous/01_cheese_sandwich@1": 3}


async def test_settings_are_applied_and_saved(session: WindowSession) -> None:
    def script() -> Iterator[None]:
        yield
        yield from session.choose("Settings")
        for _ in "player":
            post(pygame.K_BACKSPACE)
        post("Ada e")
        yield
        assert session.remembered.preferences.name == "Ada e"
        yield from session.choose("Keys")
        post(pygame.K_UP, pygame.K_DOWN, pygame.K_DOWN, pygame.K_DOWN, pygame.K_DOWN, pygame.K_DOWN)
        yield
        assert session.form.focused is not None
        yield from session.choose("Use")
        post(pygame.K_f)
        yield from wait(2)
        post(pygame.K_ESCAPE)
        yield from wait(2)
        assert session.titles[-1] == "Settings", "one back, not two"
        post(pygame.K_ESCAPE)
        yield from wait(2)
        assert session.form.title == "Hello, Ada e!"
        yield from session.choose("Quit")

    await asyncio.wait_for(session.go(script), 60)
    kept, _ = load_settings(session.folder / "window.json")
    assert (kept.preferences.name, kept.preferences.keys) == ("Ada e", {"use": ["f"]})


@pytest.mark.slow
async def test_the_tutorial_ends_with_the_whole_task(session: WindowSession) -> None:
    def script() -> Iterator[None]:
        yield
        yield from session.choose("Tutorial (two minutes)")
        yield from wait(10)
        yield from keys_of(TUTORIAL)
        assert session.titles[-1] == "Excellent!"
        assert session.remembered.learned
        yield from wait(60)
        yield from session.choose("Play a game")
        assert session.titles[-1] == "Levels"
        yield from session.choose("Back")
        yield from session.choose("Quit")

    session.app.settings.learned = False
    await asyncio.wait_for(session.go(script), 60)
    assert session.app.settings.learned


def test_each_lesson_waits_for_its_action() -> None:
    script = Script(World("training/01"))
    source = TutorialSource(script, KeyMap())
    received = [source.view().lesson]
    for line in load_certificate("training/01").plan or ():
        source.act(script.world.parse(script.state, script.me, line))
        if source.view().lesson != received[-1]:
            received.append(source.view().lesson)
            if source.lesson is not None:
                before = source.lesson
                source.act(script.world.parse(script.state, script.me, "wait()"))
                assert source.lesson is before, "to wait teaches nothing"
    assert [words.split(":")[0] for words in received] == [
        "Let's walk! Press W A S D or the arrow keys, or click on a station.",
        "Walk to an ingredient and take it",
        "Carry it to an empty table and put it down",
        "Time to work",
        "Make a tomato cheese sandwich on a table. Stack what the ticket shows from the bottom up. "
        "Tab lists all actions.",
    ]


def test_putting_a_thing_back_does_not_complete_a_lesson() -> None:
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
    carry = source.view().lesson
    for kind in ("put", "take"):
        back = [a for a in script.state.actions(script.me) if kind_of(script.state, a) == kind]
        source.act(back[0])
        assert source.lesson.kind == "put", "it lies where it was"
        assert source.view().lesson == (carry if kind == "take" else PUT_BACK)


def test_the_work_lesson_names_the_ingredient_and_waits_for_the_work() -> None:
    script = Script(World("training/01"))
    source = TutorialSource(script, KeyMap())
    seen = []
    for line in load_certificate("training/01").plan or ():
        action = script.world.parse(script.state, script.me, line)
        source.act(action)
        if action.name == "cut":
            seen.append(source.view().lesson)
    assert ["take the tomato to the board" in words for words in seen] == [True, True, False]
    assert "from the bottom up" in seen[2]


async def test_the_window_can_be_closed_anywhere(session: WindowSession) -> None:
    for first in (None, SMALL):
        await asyncio.wait_for(session.go(lambda: wait(3), first), 30)
        assert session.user.ended
    await asyncio.wait_for(session.go(lose, SHORT), 60)
    (path,) = (session.folder / "recordings").iterdir()
    assert read_recording(path).verify().ok


@virtual
async def test_open_a_kitchen_wait_and_leave(session: WindowSession) -> None:
    def script() -> Iterator[None]:
        yield
        yield from session.choose("Open a kitchen")
        yield from session.choose("Open and play")
        while session.window is None:
            yield
        yield from wait(5)
        yield from session.choose("Continue")
        post(pygame.K_ESCAPE)
        yield from wait(2)
        yield from session.choose("Leave")
        yield from session.choose("Find a kitchen")
        while session.titles[-1] != "Kitchens":
            yield
        assert "lettuce burger" in session.form.rows[0].label
        yield from session.choose("Back")
        yield from session.choose("Quit")

    async with serving(session.folder / "server") as server:
        session.app.settings.prefer(server=server.url)
        session.app.settings.task = "multi_agent/01"
        await session.go_online(script())
        assert session.app.settings.code
        async with connect(server.url, name="bob") as bob:
            (found,) = await bob.episodes()
            assert found.code == session.app.settings.code


@pytest.mark.parametrize("leaves", [True, False])
@virtual
async def test_without_a_menu_the_window_closes_after_the_game(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, leaves: bool
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    session = WindowSession(tmp_path, menu=False)
    session.watch(monkeypatch)
    async with serving(tmp_path / "server") as server:
        room = server.lobby.create(Create(task="multi_agent/02"))

        def script() -> Iterator[None]:
            while session.window is None:
                yield
            yield from wait(5)
            if leaves:
                post(pygame.K_ESCAPE)
                yield from wait(2)
                assert session.labels == ["Keep playing", "Leave"]
                yield from session.choose("Leave")
            else:
                room.abort("enough")
                yield from wait(60)
                assert "Menu" not in session.labels
                yield from session.choose("Close")
            yield from wait(20)
            raise AssertionError("it is still open")

        await session.go_online(script(), session.app.remote.join(room.code, url=server.url))


@pytest.fixture
def renderings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return own_renderings(tmp_path, monkeypatch)


@pytest.fixture
def open_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., App]]:
    """Save settings to the user's file, and open the app with start options."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setattr("robotouille_client.window.require_screen", lambda: None)
    apps: list[App] = []

    def open_it(settings: Settings, options: StartOptions | None = None) -> App:
        assert not save_settings(settings, settings_path())
        apps.append(open_app(options) if options else open_app())
        return apps[0]

    yield open_it
    for app in apps:
        app.ui.close()


async def test_choosing_an_incomplete_look_reports_it(
    session: WindowSession, renderings: Path
) -> None:
    app = session.app
    whole = {"extends": "robotouille", "progress": {"cook": "icon_flame.svg"}}
    lacking = {"extends": "robotouille", "progress": {"cokk": "icon_flame.svg"}}
    for name, look in (("whole", whole), ("lacking", lacking), ("broken", {"flor": 1})):
        (renderings / f"{name}.json").write_text(json.dumps(look))
    menu = SettingsMenu(app.settings, app.apply_setting)
    row = next(row for row in menu.form.rows if row.label == "Look")
    received = {}
    assert isinstance(row, Choice)
    for _ in range(4):
        row.command(Command.USE)
        received[row.value] = (menu.form.message, app.ui.preferences.rendering)
    said, kept = received["broken"]
    assert said.startswith("Could not load the look 'broken'")
    assert "flor: unknown field" in said
    assert kept == ""
    assert received["chalk"] == ("Changes apply at once.", "chalk")
    assert received["whole"] == ("Changes apply at once.", "whole")
    said, kept = received["lacking"]
    assert "'lacking' lacks pictures" in said
    assert "no action 'cokk'; did you mean 'cook'?" in said
    assert kept == "lacking"


@pytest.mark.parametrize(
    ("name", "used", "message"),
    [("marble", "", "'marble'"), ("mine", "mine", "there is no picture 'no.svg'")],
)
def test_a_fault_of_the_remembered_look_is_reported(
    open_saved: Callable[..., App], renderings: Path, name: str, used: str, message: str
) -> None:
    (renderings / "mine.json").write_text('{"extends": "robotouille", "icons": {"app": "no.svg"}}')
    app = open_saved(Settings(rendering=name))
    assert app.ui.preferences.rendering == used
    assert message in app.ui.message


def test_a_size_option_overrides_full_screen_for_one_run(open_saved: Callable[..., App]) -> None:
    app = open_saved(Settings(fullscreen=True), StartOptions(size="640x480"))
    assert (app.ui.display.size, app.ui.display.fullscreen) == ((640, 480), False)
    app.ui.remember()
    assert load_settings(settings_path())[0].preferences.fullscreen


def test_the_command_line_server_is_used_for_this_run(open_saved: Callable[..., App]) -> None:
    app = open_saved(Settings(), StartOptions(server="ws://there"))
    assert app.ui.preferences.server == "ws://there"
    app.ui.remember()
    assert "ws://there" not in settings_path().read_text()


async def test_the_app_continues_if_settings_cannot_be_saved(session: WindowSession) -> None:
    (session.folder / "file").write_text("")
    path = session.folder / "file" / "window.json"
    session.app.ui.file = SettingsFile(path, session.app.settings)
    await asyncio.wait_for(session.go(lambda: wait(2)), 30)
    assert "Could not save" in session.app.ui.message


async def test_a_card_explains_a_shift_before_its_clock_starts(session: WindowSession) -> None:
    setup = GameSetup("shifts/01_sandwich_bar", seats=1, countdown=0.0)

    def script() -> Iterator[None]:
        yield from wait(60)
        assert session.titles == ["Sandwich bar"]
        words = [row.label for row in session.form.rows]
        assert "Hatch: build dishes here; a complete dish is served." in words
        assert words[-3:] == [
            "The shift lasts 3 minutes.",
            "One star needs 87 points, two need 175, three need 264.", "Start",
        ]  # fmt: skip
        keys = session.window.overlay(session.source.view()).keys
        assert keys == (("Enter", "start"), ("Esc", "leave"))
        assert session.source.view().step == 0
        yield from session.choose("Start")
        yield from wait(60)
        assert session.source.view().step > 0
        post(pygame.K_h)
        yield from wait(2)
        rows = session.window.overlay(session.source.view()).help
        assert rows[0] == ("", "The game is paused where it is.")
        assert "Orders" in [key for key, _ in rows]

    await asyncio.wait_for(session.go(script, setup), 60)


async def test_escape_leaves_a_game_before_its_start(session: WindowSession) -> None:
    def script() -> Iterator[None]:
        yield from wait(60)
        assert session.titles == ["Sandwich bar"]
        post(pygame.K_ESCAPE)
        yield from wait(60)
        assert "Levels" in [row.label for row in session.form.rows]

    setup = GameSetup("shifts/01_sandwich_bar", seats=1, countdown=0.0)
    await asyncio.wait_for(session.go(script, setup), 60)
    assert not list((session.folder / "recordings").glob("*.rbt*"))


@pytest.mark.parametrize(
    ("setup", "stars"),
    [
        pytest.param(
            GameSetup("shifts/01_sandwich_bar", seats=1, max_steps=3, countdown=0.0),
            "One star needs 87 points, two need 175, three need 264.",
            marks=pytest.mark.slow,
        ),
        (
            GameSetup("synchronous/01", max_steps=3, countdown=0.0),
            "Three stars need at most 72 steps (14 s), two need 89 steps (18 s)."
            " Any finished game earns one.",
        ),
    ],
)
async def test_each_game_against_time_begins_with_what_the_stars_need(
    session: WindowSession, setup: GameSetup, stars: str
) -> None:
    played: list[int] = []

    def script() -> Iterator[None]:
        for _ in range(2):
            yield from wait(60)
            assert stars in [row.label for row in session.form.rows]
            played.append(session.source.view().step)
            yield from session.choose("Start")
            yield from wait(150)
            yield from session.choose("Play again")

    await asyncio.wait_for(session.go(script, setup), 60)
    assert played == [0, 0]
    assert session.user.ended
    recorded = [*(session.folder / "recordings").iterdir()]
    assert len(recorded) == 2
    shifts = [recording.world.shift for recording in map(read_recording, recorded)]
    orders = [shift.arrivals for shift in shifts if shift is not None]
    assert len(set(orders)) == len(orders), "a shift played again has other orders"
