"""The window's loop: events become actions and words; time is injected."""

from __future__ import annotations

import asyncio
import dataclasses

import pygame
import pytest
from tests.support.window_play import Timer

from robotouille import GroundAction, State, Timing, World, load_task
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.view import FarewellView, PauseView, View
from robotouille_client.window.window import Window

SIZE = (800, 600)


def plain(action: GroundAction) -> str:
    """An action without the order of its arguments, which is the domain's affair."""
    return " ".join([action.name, *sorted(action.arguments)])


class Script:
    """A source that plays by itself what it is told, and notes what it is told."""

    def __init__(self, world: World, me: str | None = "robot1") -> None:
        self.world = world
        self.me = me
        self.states: list[State] = [world.initial]
        self.acted: list[str] = []
        self.said: list[str] = []
        self.finished = False
        self.interruption: dict[str, object] = {}

    def view(self) -> View:
        before = self.states[-2] if len(self.states) > 1 else None
        step = len(self.states) - 1
        view = View(self.world, self.states[-1], before, step, me=self.me)
        return dataclasses.replace(view, **self.interruption)

    def act(self, action: GroundAction) -> None:
        self.acted.append(plain(action))
        self.states.append(self.states[-1].step(action).state)

    def say(self, text: str) -> None:
        self.said.append(text)

    def wait(self) -> None:
        self.states.append(self.states[-1].step([]).state)


@pytest.fixture
def source() -> Script:
    return Script(World("asynchronous/09"))


@pytest.fixture
def window(tmp_path):
    timer = Timer()
    window = Window(
        SIZE, fps=50, headless=True, screenshots=tmp_path, clock=timer, sleep=timer.sleep
    )
    window.timer = timer
    yield window
    window.close()


def spot(world: World, name: str) -> tuple[int, int]:
    problem = world.task.problem
    return layout(SIZE, problem.width, problem.height).cell(world.thing(name).tile).center


def click(world: World, name: str, button: int = 1) -> None:
    pos = spot(world, name)
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(0, 0, 0)))
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=button))


def press(*keys: int | str) -> None:
    """Keys by number, or text as typed."""
    for key in keys:
        if isinstance(key, str):
            for letter in key:
                code = pygame.key.key_code("space" if letter == " " else letter)
                pygame.event.post(pygame.Event(pygame.KEYDOWN, key=code, mod=0, unicode=letter))
                pygame.event.post(pygame.Event(pygame.TEXTINPUT, text=letter))
        else:
            pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))


def test_clicks_and_keys_act(window: Window, source: Script) -> None:
    window.frame(source)
    for name in ("table11", "table11", "stove1", "stove1"):
        click(source.world, name)
        window.frame(source)
    press(pygame.K_e, pygame.K_SPACE)
    window.frame(source)
    assert source.acted == [
        "move robot1 table11 table8",
        "pick-up-item chicken1 robot1 table11",
        "move robot1 stove1 table11",
        "place-item chicken1 robot1 stove1",
        "cook chicken1 robot1 stove1",
        "wait",
    ]


def test_a_click_of_another_button_or_beside_the_stations_does_nothing(window, source) -> None:
    window.frame(source)
    click(source.world, "table11", button=3)
    click(source.world, "table11", button=4)
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=(1, 1), button=1))
    press(pygame.K_q, pygame.K_F5)
    window.frame(source)
    assert source.acted == []


def test_a_spectator_cannot_act(window: Window) -> None:
    source = Script(World("asynchronous/09"), me=None)
    window.frame(source)
    click(source.world, "table11")
    press(pygame.K_e)
    window.frame(source)
    assert source.acted == []


def test_who_is_busy_does_it_afterwards(window: Window) -> None:
    source = Script(World(load_task("asynchronous/09", timing=Timing.PEOPLE)))
    window.frame(source)
    click(source.world, "table2")
    click(source.world, "table2")
    window.frame(source)
    window.frame(source)
    assert source.acted == ["move robot1 table2 table8"]
    while source.states[-1].busy_steps("robot1"):
        source.wait()
    window.frame(source)
    assert source.acted[-1] == "pick-up-container pot1 robot1 table2"


def test_escape_forgets_what_was_to_come(window: Window) -> None:
    source = Script(World(load_task("asynchronous/09", timing=Timing.PEOPLE)))
    window.frame(source)
    for _ in range(2):
        click(source.world, "table2")
        window.frame(source)
    press(pygame.K_ESCAPE)
    window.frame(source)
    while source.states[-1].busy_steps("robot1"):
        source.wait()
    window.frame(source)
    assert len(source.acted) == 1


INTERRUPTIONS = [
    {"pause": PauseView("bob's connection is lost", "Waiting 23 s.", 22.4, 0.7)},
    {"offline": 1.5},
    {"farewell": FarewellView("Out", "Gone.")},
    {"outcome": "Out of steps after 300 steps"},
]


@pytest.mark.parametrize("interruption", INTERRUPTIONS)
def test_while_a_game_is_interrupted_keys_and_clicks_do_nothing(
    window: Window, source: Script, interruption: dict[str, object]
) -> None:
    window.frame(source)
    source.interruption = interruption
    click(source.world, "table11")
    press(pygame.K_SPACE, pygame.K_e)
    window.frame(source)
    window.frame(source)
    assert source.acted == []
    source.interruption = {}
    window.frame(source)
    assert source.acted == [], "what was pressed meanwhile does not come later"
    click(source.world, "table11")
    window.frame(source)
    assert source.acted == ["move robot1 table11 table8"]


def test_a_kitchen_that_is_finished_offers_nothing(window: Window, source: Script) -> None:
    window.frame(source)
    press(pygame.K_TAB)
    window.frame(source)
    pos = spot(source.world, "table11")
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(0, 0, 0)))
    window.frame(source)
    before = window.overlay(source.view())
    assert before.choices
    assert before.tips
    source.interruption = {"outcome": "Out of steps after 300 steps"}
    window.frame(source)
    after = window.overlay(source.view())
    assert (after.choices, after.tips, after.hints, after.queued) == (None, (), (), ())


def test_one_can_chat_while_a_game_is_paused(window: Window, source: Script) -> None:
    source.interruption = INTERRUPTIONS[0]
    window.frame(source)
    press("twaiting", pygame.K_RETURN)
    window.frame(source)
    assert source.said == ["waiting"]


def test_what_was_to_come_next_comes_after_the_pause(window: Window) -> None:
    source = Script(World(load_task("asynchronous/09", timing=Timing.PEOPLE)))
    window.frame(source)
    for _ in range(2):
        click(source.world, "table2")
        window.frame(source)
    source.interruption = INTERRUPTIONS[0]
    while source.states[-1].busy_steps("robot1"):
        source.wait()
    window.frame(source)
    assert len(source.acted) == 1
    source.interruption = {}
    window.frame(source)
    assert source.acted[-1] == "pick-up-container pot1 robot1 table2"


def test_chat(window: Window, source: Script) -> None:
    window.frame(source)
    press("the", pygame.K_BACKSPACE, "i there e", pygame.K_RETURN)
    press("tx", pygame.K_ESCAPE)
    press(pygame.K_RETURN, "ok", pygame.K_RETURN)
    press("t", pygame.K_RETURN)
    window.frame(source)
    assert source.said == ["hi there e", "ok"]
    assert source.acted == []


def test_help_covers_the_kitchen_until_a_click(window: Window, source: Script) -> None:
    window.frame(source)
    before = pygame.image.tobytes(pygame.display.get_surface(), "RGB")
    press(pygame.K_h)
    window.frame(source)
    assert pygame.image.tobytes(pygame.display.get_surface(), "RGB") != before
    click(source.world, "table11")
    window.frame(source)
    assert source.acted == []
    click(source.world, "table11")
    window.frame(source)
    assert len(source.acted) == 1


def test_hovering_is_seen(window: Window, source: Script) -> None:
    window.frame(source)
    before = pygame.image.tobytes(pygame.display.get_surface(), "RGB")
    pos = spot(source.world, "stove1")
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(0, 0, 0)))
    window.frame(source)
    during = pygame.image.tobytes(pygame.display.get_surface(), "RGB")
    pygame.event.post(pygame.Event(pygame.WINDOWLEAVE))
    window.frame(source)
    assert during != before
    assert pygame.image.tobytes(pygame.display.get_surface(), "RGB") == before


def test_pictures(window: Window, source: Script, tmp_path) -> None:
    window.frame(source)
    press(pygame.K_F12)
    window.frame(source)
    (path,) = tmp_path.glob("robotouille-*.png")
    assert pygame.image.load(path).get_size() == SIZE
    window.screenshot(tmp_path / "own.png")
    assert (tmp_path / "own.png").is_file()


def test_a_picture_that_cannot_be_saved_is_no_error(window, source, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    window.screenshots = tmp_path / "file" / "folder"
    window.frame(source)
    press(pygame.K_F12)
    window.frame(source)
    assert not window.closed


def test_the_folder_for_pictures_is_made_when_there_is_one(window, source, tmp_path) -> None:
    window.screenshots = tmp_path / "of" / "pictures"
    window.frame(source)
    assert not window.screenshots.exists()
    press(pygame.K_F12)
    window.frame(source)
    assert len(list(window.screenshots.iterdir())) == 1


async def test_closing_ends_the_run(window: Window, source: Script) -> None:
    task = asyncio.create_task(window.run(source))
    await asyncio.sleep(0)
    pygame.event.post(pygame.Event(pygame.QUIT))
    await asyncio.wait_for(task, 5)
    assert window.closed


@pytest.mark.parametrize("linger", [0.0, 2.0])
async def test_the_run_lingers_after_the_end(window, source, linger: float) -> None:
    source.finished = True
    await asyncio.wait_for(window.run(source, linger=linger), 5)
    assert window.frames == pytest.approx(linger * 50 + 1, abs=1)
    assert window.timer.now == pytest.approx(100 + linger, abs=0.03)


async def test_an_outcome_stays_until_closed(window: Window, source: Script) -> None:
    source.finished = True
    task = asyncio.create_task(window.run(source, linger=None))
    while window.frames < 50:
        await asyncio.sleep(0)
    assert not task.done()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert window.closed


async def test_a_slow_frame_is_not_made_up_for(window: Window, source: Script) -> None:
    original = window.frame

    def slow(of: Script) -> None:
        original(of)
        window.timer.now += 0.5
        source.finished = window.frames == 4

    window.frame = slow  # type: ignore[method-assign]
    await asyncio.wait_for(window.run(source, linger=0.0), 5)
    assert window.frames == 4
    assert window.timer.now == pytest.approx(102.0)


def test_another_world_in_the_same_window(window: Window, source: Script) -> None:
    window.frame(source)
    other = Script(World("workshop/01"), me="fitter1")
    window.frame(other)
    click(other.world, "anvil1")
    window.frame(other)
    assert other.acted == ["walk anvil1 fitter1 trestle2"]
    assert dataclasses.is_dataclass(other.view())


class Ruler:
    """A strip of three lines that takes clicks, and the key S."""

    lines = 3.0

    def __init__(self) -> None:
        self.areas: list[pygame.Rect] = []
        self.clicks = 0
        self.colour = "red"
        self.ticks = 0

    def tick(self) -> None:
        self.ticks += 1

    def seen(self) -> object:
        return self.colour

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, view: View
    ) -> None:
        target.fill(self.colour, area)
        self.areas.append(area)

    def covers(self, position: tuple[int, int]) -> bool:
        return bool(self.areas) and self.areas[-1].collidepoint(position)

    def handle(self, event: pygame.Event, area: pygame.Rect) -> bool:
        if event.type == pygame.MOUSEBUTTONDOWN and area.collidepoint(event.pos):
            self.clicks += 1
            return True
        return event.type == pygame.KEYDOWN and event.key == pygame.K_s


def test_a_strip_has_room_of_its_own_and_is_asked_first() -> None:
    source, ruler = Script(World(load_task("synchronous/01"))), Ruler()
    window = Window(SIZE, headless=True, strip=ruler)
    window.frame(source)
    (area,) = ruler.areas
    plan = layout(SIZE, source.world.task.problem.width, source.world.task.problem.height, 3.0)
    assert area == plan.strip
    assert area.height == 3 * plan.text
    assert plan.kitchen.bottom <= area.top
    assert area.right == plan.panel.left
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=area.center, button=1))
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_s, unicode="s", mod=0))
    window.frame(source)
    assert ruler.clicks == 1
    assert not source.acted
    window.close()


def test_a_strip_is_drawn_when_it_looks_different() -> None:
    source, ruler = Script(World(load_task("synchronous/01"))), Ruler()
    window = Window(SIZE, headless=True, strip=ruler)
    for _ in range(5):
        window.frame(source)
    pygame.event.clear()
    drawn, ticks = window.drawn, ruler.ticks
    for _ in range(3):
        window.frame(source)
    assert (window.drawn, ruler.ticks) == (drawn, ticks + 3)
    ruler.colour = "blue"
    for _ in range(3):
        window.frame(source)
    assert window.drawn == drawn + 1
    window.close()
