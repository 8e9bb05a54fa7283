"""The window's loop: events of keyboard, mouse and gamepad become actions and chat."""

from __future__ import annotations

import asyncio
import dataclasses
from pathlib import Path

import pygame
import pytest
from tests.support.window_play import SIZE, Script, Timer, at, click, goes_to, headless_window, way

from robotouille import Timing, World, load_task
from robotouille.certification.certificate import load_certificate
from robotouille_client.window.input.action_queue import GUARD_SECONDS
from robotouille_client.window.input.commands import Command
from robotouille_client.window.view import FarewellView, PauseView, View
from robotouille_client.window.window import Window


@pytest.fixture
def busy() -> Game:
    """Game in which a walk takes several steps."""
    return Game(World(load_task("asynchronous/09", timing=Timing.PEOPLE)))


@pytest.fixture
def window(tmp_path):
    timer = Timer()
    window = headless_window(SIZE, fps=50, screenshots=tmp_path, clock=timer, sleep=timer.sleep)
    window.timer = timer
    return window


def press(*keys: int | str) -> None:
    """Post keys by number, or text as typed."""
    for key in keys:
        if isinstance(key, str):
            for letter in key:
                code = pygame.key.key_code("space" if letter == " " else letter)
                pygame.event.post(pygame.Event(pygame.KEYDOWN, key=code, mod=0, unicode=letter))
                pygame.event.post(pygame.Event(pygame.TEXTINPUT, text=letter))
        else:
            pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))


class Game(Script):
    """Game that can be interrupted, and ended."""

    over = False

    def __init__(self, world: World, me: str | None = None) -> None:
        super().__init__(world, me)
        self.interruption: dict[str, object] = {}

    @property
    def finished(self) -> bool:
        return self.over

    def view(self) -> View:
        return dataclasses.replace(super().view(), **self.interruption)

    @property
    def did(self) -> list[str]:
        """Actions without the player."""
        return [" ".join((a.name, *sorted(a.arguments[1:]))) for a in self.acted]


def point(at: tuple[int, int]) -> None:
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=at, rel=(0, 0), buttons=(0, 0, 0)))


def pixels() -> bytes:
    return pygame.image.tobytes(pygame.display.get_surface(), "RGB")


@pytest.fixture
def source() -> Game:
    return Game(World("asynchronous/09"))


def test_other_clicks_do_nothing(window: Window, source: Game) -> None:
    window.frame(source)
    for button in (3, 4):
        click(window, source, "table11", button)
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=(1, 1), button=1))
    press(pygame.K_q, pygame.K_F5)
    window.frame(source)
    assert source.acted == []


def test_a_spectator_cannot_act(window: Window, source: Game) -> None:
    source.interruption = {"me": None}
    window.frame(source)
    click(window, source, "table11")
    press(pygame.K_e)
    window.frame(source)
    assert source.acted == []


INTERRUPTIONS = [
    {"pause": PauseView("bob's connection is lost", "Waiting 23 s.", 22.4, 0.7)},
    {"offline": 1.5},
    {"farewell": FarewellView("Out", "Gone.")},
    {"outcome": "Out of steps after 300 steps"},
]


@pytest.mark.parametrize("interruption", INTERRUPTIONS)
def test_input_during_an_interruption_does_nothing(
    window: Window, source: Game, interruption: dict[str, object]
) -> None:
    window.frame(source)
    source.interruption = interruption
    click(window, source, "table11")
    press(pygame.K_SPACE, pygame.K_e)
    window.frame(source)
    source.interruption = {}
    window.frame(source)
    assert source.acted == [], "the input is not kept for later"
    click(window, source, "table11")
    assert source.did == ["move table11 table8"]


def test_a_finished_game_offers_no_actions(window: Window, source: Game) -> None:
    window.frame(source)
    press(pygame.K_TAB)
    point(at(source.world, "table11"))
    window.frame(source)
    before = window.overlay(source.view())
    assert before.choices
    assert before.tips
    source.interruption = {"outcome": "Out of steps after 300 steps"}
    window.frame(source)
    after = window.overlay(source.view())
    assert (after.choices, after.tips, after.hints, after.queued) == (None, (), (), ())


def test_chat_during_a_pause(window: Window, source: Game) -> None:
    source.interruption = INTERRUPTIONS[0]
    window.frame(source)
    press("twaiting", pygame.K_RETURN)
    window.frame(source)
    assert source.said == ["waiting"]


def test_the_queue_continues_after_a_pause(window: Window, busy: Game) -> None:
    window.frame(busy)
    for _ in range(2):
        click(window, busy, "table2")
    busy.interruption = INTERRUPTIONS[0]
    while busy.state.busy_steps("robot1"):
        busy.step()
    window.frame(busy)
    assert len(busy.acted) == 1
    busy.interruption = {}
    window.frame(busy)
    assert busy.did[-1] == "pick-up-container pot1 table2"


def test_chat(window: Window, source: Game) -> None:
    window.frame(source)
    press("the", pygame.K_BACKSPACE, "i there e", pygame.K_RETURN)
    press("tx", pygame.K_ESCAPE)
    press(pygame.K_RETURN, "ok", pygame.K_RETURN)
    press("t", pygame.K_RETURN)
    window.frame(source)
    assert source.said == ["hi there e", "ok"]
    assert source.acted == []


def test_help_covers_the_kitchen_until_a_click(window: Window, source: Game) -> None:
    window.frame(source)
    before = pixels()
    press(pygame.K_h)
    window.frame(source)
    assert pixels() != before
    click(window, source, "table11")
    assert source.acted == []
    click(window, source, "table11")
    assert len(source.acted) == 1


def test_hovering_shows_a_tip(window: Window, source: Game) -> None:
    window.frame(source)
    before = pixels()
    point(at(source.world, "stove1"))
    window.frame(source)
    assert pixels() != before
    pygame.event.post(pygame.Event(pygame.WINDOWLEAVE))
    window.frame(source)
    assert pixels() == before


def test_screenshots_create_their_folder(window: Window, source: Game, tmp_path: Path) -> None:
    window.screenshots = tmp_path / "of" / "pictures"
    window.frame(source)
    assert not window.screenshots.exists()
    press(pygame.K_F12)
    window.frame(source)
    (path,) = window.screenshots.glob("robotouille-*.png")
    assert pygame.image.load(path).get_size() == SIZE


def test_a_failed_screenshot_shows_a_notice(window: Window, source: Game, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    window.screenshots = tmp_path / "file" / "folder"
    window.frame(source)
    press(pygame.K_F12)
    window.frame(source)
    assert not window.closed
    assert window.overlay(source.view()).prompt


async def test_closing_ends_the_run(window: Window, source: Game) -> None:
    task = asyncio.create_task(window.run(source))
    await asyncio.sleep(0)
    pygame.event.post(pygame.Event(pygame.QUIT))
    await asyncio.wait_for(task, 5)
    assert window.closed


@pytest.mark.parametrize("linger", [0.0, 2.0])
async def test_the_run_lingers_after_the_end(window, source, linger: float) -> None:
    source.over = True
    await asyncio.wait_for(window.run(source, linger=linger), 5)
    assert window.frames == pytest.approx(linger * 25 + 1, abs=1)
    assert window.timer.now == pytest.approx(100 + linger, abs=0.05)


async def test_an_outcome_stays_until_closed(window: Window, source: Game) -> None:
    source.over = True
    task = asyncio.create_task(window.run(source, linger=None))
    while window.frames < 50:
        await asyncio.sleep(0)
    assert not task.done()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert window.closed


async def test_a_slow_frame_is_not_followed_by_fast_ones(window: Window, source: Game) -> None:
    original = window.frame

    def slow(of: Game) -> None:
        original(of)
        window.timer.now += 0.5
        source.over = window.frames == 4

    window.frame = slow
    await asyncio.wait_for(window.run(source, linger=0.0), 5)
    assert window.frames == 4
    assert window.timer.now == pytest.approx(102.0, abs=0.05)


def test_another_world_in_the_same_window(window: Window, source: Game) -> None:
    window.frame(source)
    other = Game(World("workshop/01"))
    window.frame(other)
    click(window, other, "anvil1")
    assert other.did == ["walk anvil1 trestle2"]


PADS = {
    Command.LEFT: pygame.CONTROLLER_BUTTON_DPAD_LEFT,
    Command.RIGHT: pygame.CONTROLLER_BUTTON_DPAD_RIGHT,
    Command.UP: pygame.CONTROLLER_BUTTON_DPAD_UP,
    Command.DOWN: pygame.CONTROLLER_BUTTON_DPAD_DOWN,
}


class Pad:
    def __init__(self, task: str) -> None:
        self.timer = Timer()
        self.source = Script(World(task))
        self.window = headless_window(SIZE, clock=self.timer)
        self.window.frame(self.source)

    def press(self, *buttons: int) -> None:
        for button in buttons:
            for kind in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
                pygame.event.post(pygame.Event(kind, button=button, instance_id=0))
                self.window.frame(self.source)

    def tilt(self, axis: int, value: int) -> None:
        event = pygame.Event(pygame.CONTROLLERAXISMOTION, axis=axis, value=value, instance_id=0)
        pygame.event.post(event)
        self.window.frame(self.source)

    def overlay(self):
        return self.window.overlay(self.source.view())


@pytest.fixture
def pad() -> Pad:
    return Pad("training/01")


@pytest.mark.parametrize("task", ["synchronous/01", "training/01"])
def test_a_whole_task_by_gamepad_alone(task: str) -> None:
    pad = Pad(task)
    source = pad.source
    for line in load_certificate(task).plan or ():
        action = source.world.parse(source.state, source.me, line)
        station = goes_to(action)
        if station is None:
            pad.timer.now += GUARD_SECONDS
            pad.press(pygame.CONTROLLER_BUTTON_A)
            assert source.acted[-1] == action
        else:
            pad.press(*[PADS[c] for c in way(source.state, source.me, station)])
    assert source.finished


def test_a_stick_walks_once_and_repeats_while_held(pad: Pad) -> None:
    for value in (8_000, 21_000, 25_000, 19_000):
        pad.tilt(pygame.CONTROLLER_AXIS_LEFTX, -value)
    assert len(pad.source.acted) == 1
    pad.timer.now += 0.4
    pad.window.frame(pad.source)
    assert len(pad.source.acted) == 2
    pad.tilt(pygame.CONTROLLER_AXIS_LEFTX, -3_000)
    pad.timer.now += 1.0
    pad.window.frame(pad.source)
    walked = len(pad.source.acted)
    pad.window.frame(pad.source)
    assert len(pad.source.acted) == walked
    pad.tilt(pygame.CONTROLLER_AXIS_RIGHTX, 30_000)
    assert len(pad.source.acted) == walked


def test_open_and_close_list_and_help(pad: Pad) -> None:
    pad.press(pygame.CONTROLLER_BUTTON_X, pygame.CONTROLLER_BUTTON_DPAD_DOWN)
    assert pad.overlay().chosen == 1
    pad.press(pygame.CONTROLLER_BUTTON_B)
    assert pad.overlay().choices is None
    pad.press(pygame.CONTROLLER_BUTTON_Y)
    assert pad.overlay().help
    pad.press(pygame.CONTROLLER_BUTTON_B, pygame.CONTROLLER_BUTTON_X, pygame.CONTROLLER_BUTTON_A)
    assert len(pad.source.acted) == 1


def test_connecting_and_disconnecting_shows_a_notice(pad: Pad) -> None:
    pygame.event.post(pygame.Event(pygame.CONTROLLERDEVICEREMOVED, instance_id=3))
    pad.window.frame(pad.source)
    assert "disconnected" in pad.overlay().prompt
    pygame.event.post(pygame.Event(pygame.CONTROLLERDEVICEADDED, device_index=99))
    pad.window.frame(pad.source)
    assert "connected" in pad.overlay().prompt
