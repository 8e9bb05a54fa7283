"""Every task can be painted at any size, and what a view says is seen."""

from __future__ import annotations

import dataclasses
import random

import pygame
import pytest
from tests.support.samples import first_quickly

from robotouille import World, task_names
from robotouille.world.unmet import from_words
from robotouille_client.window.drawing.painter import Painter, paint
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.sources.chat_log import ChatLog
from robotouille_client.window.view import Bubble, FarewellView, PauseView, SeatView, View


def picture(view: View, size=(640, 400), ui_overlay: UiOverlay | None = None) -> bytes:
    surface = pygame.Surface(size)
    Painter().paint(surface, view, ui_overlay)
    return pygame.image.tobytes(surface, "RGB")


def colours(pixels: bytes) -> int:
    return len({pixels[i : i + 3] for i in range(0, len(pixels), 3 * 7)})


def full_view(world: World, steps: int, seed: int = 1) -> View:
    """A view in the middle of a game of random actions, with everything a view can have."""
    generator = random.Random(seed)
    previous = state = world.initial
    for _ in range(steps):
        previous = state
        state = state.step(
            {p: generator.choice(a) for p in world.players if (a := state.actions(p))}
        ).state
    seats = [SeatView(p, f"Name {p}", actions=3, rejected=1) for p in world.players]
    return View(
        world, state, previous, steps, 50, "real time", 0.4, tuple(seats), world.players[0],
        (Bubble(world.players[0], "no"),), (("Ada", "hello"),), "waiting", "CODE", "", None,
    )  # fmt: skip


@pytest.mark.parametrize("name", first_quickly(task_names(), 8))
def test_every_task(name: str) -> None:
    view = full_view(World(name), 12)
    assert colours(picture(view)) > 250


@pytest.mark.parametrize("size", [(1280, 720), (800, 600), (300, 900), (1000, 120), (1, 1)])
def test_any_size(size: tuple[int, int]) -> None:
    world = World("multi_agent/10")
    shown = picture(
        full_view(world, 5), size, UiOverlay((0, 0), ("tip",), "prompt", "hi", (("H", "x"),))
    )
    assert len(shown) == size[0] * size[1] * 3


@pytest.mark.parametrize(
    "change",
    [
        {"step": 6}, {"max_steps": 70}, {"clock": "lockstep"}, {"phase": 0.9}, {"me": None},
        {"bubbles": ()}, {"chat": ()}, {"status": ""}, {"code": ""}, {"outcome": "Goal reached"},
        {"starts_in": 2.5}, {"watching": 2}, {"blocked": (("robot1", "stove1", "robot1"),)},
        {"hover": "table1"}, {"seats": ()}, {"notice": "lunch"}, {"offline": 0.5},
        {"pause": PauseView("Paused by the operator")}, {"farewell": FarewellView("Out", "Gone.")},
    ],
)  # fmt: skip
def test_every_field_is_seen(change) -> None:
    view = full_view(World("multi_agent/09"), 5)
    assert picture(dataclasses.replace(view, **change)) != picture(view)


def test_losing_does_not_look_like_winning() -> None:
    view = full_view(World("multi_agent/01"), 3)
    ended = dataclasses.replace(view, outcome="Over")
    assert picture(dataclasses.replace(ended, won=True)) != picture(ended)


def test_a_countdown_moves_between_two_frames_and_its_number_with_it() -> None:
    view = full_view(World("multi_agent/09"), 5)
    shown = [
        picture(dataclasses.replace(view, pause=PauseView("bob is away", "", left, left / 30)))
        for left in (22.9, 22.8, 21.9)
    ]
    assert len(set(shown)) == 3


def test_how_long_a_connection_has_been_lost_is_seen() -> None:
    view = full_view(World("multi_agent/09"), 5)
    assert len({picture(dataclasses.replace(view, offline=s)) for s in (5.0, 5.5, 6.0)}) == 2


@pytest.mark.parametrize(
    "change",
    [
        {"connected": False},
        {"connected": False, "stand_in": "planner"},
        {"connected": False, "name": ""},
        {"connected": False, "name": "", "stand_in": "planner"},
    ],
)
def test_who_moves_a_player_is_seen_at_its_seat_and_at_the_player(change) -> None:
    view = full_view(World("multi_agent/09"), 5)
    first, *others = view.seats
    changed = dataclasses.replace(view, seats=(dataclasses.replace(first, **change), *others))
    (left, top, width, height) = layout((640, 400), 9, 7).panel
    for area in (pygame.Rect(0, 0, left, height), pygame.Rect(left, top, width, height)):
        parts = []
        for shown in (view, changed):
            surface = pygame.Surface((640, 400))
            Painter().paint(surface, shown)
            parts.append(pygame.image.tobytes(surface.subsurface(area), "RGB"))
        assert parts[0] != parts[1]


SIZES = [((160, 120),), ((1280, 720),), ((300, 900),), ((1000, 120),)]


@pytest.mark.parametrize("size", first_quickly(SIZES))
def test_interruptions_fit_any_size(size: tuple[int, int]) -> None:
    """The panel is never drawn over."""
    view = full_view(World("multi_agent/10"), 5)
    nasty = "厨房 \0 " + "words and " * 60
    panel = layout(size, *_floor(view.world)).panel
    shown = []
    for change in (
        {},
        {"pause": PauseView(nasty, nasty, 12345.6), "offline": 99.0, "notice": nasty},
        {"farewell": FarewellView(nasty, nasty)},
    ):
        surface = pygame.Surface(size)
        Painter().paint(surface, dataclasses.replace(view, **change))
        shown.append(pygame.image.tobytes(surface.subsurface(panel), "RGB"))
    assert len(set(shown)) == 1


def _floor(world: World) -> tuple[int, int]:
    return world.task.problem.width, world.task.problem.height


@pytest.mark.parametrize(
    "ui_overlay",
    [
        UiOverlay(prompt="E: cut"),
        UiOverlay(typing=""),
        UiOverlay(help=(("E", "cut"),)),
        UiOverlay(pointer=(200, 200), tips=("Move", "there")),
    ],
)
def test_chrome_is_seen(ui_overlay: UiOverlay) -> None:
    view = full_view(World("multi_agent/09"), 5)
    assert picture(view, ui_overlay=ui_overlay) != picture(view)


def test_any_text_can_be_drawn() -> None:
    view = full_view(World("multi_agent/09"), 1)
    nasty = "nul \0 lone \ud800 tab \t new\nline 厨房 " + "x" * 5000
    seats = tuple(dataclasses.replace(s, name=nasty, kind=nasty) for s in view.seats)
    chat = ((nasty, nasty), ("", ""))
    picture(dataclasses.replace(
        view, seats=seats, chat=chat, status=nasty, code=nasty, outcome=nasty, clock=nasty,
        bubbles=(Bubble("robot1", nasty), Bubble("robot2", ""), Bubble("nobody", "x")),
    ))  # fmt: skip


def test_progress_is_drawn_where_something_cooks(play) -> None:
    world = World("asynchronous/09")
    lines = ["move table11", "pick-up-item chicken1", "move stove1", "place-item", "cook", "-"]
    course = play(world, *lines)
    place = layout((640, 400), world.task.problem.width, world.task.problem.height)
    cell = place.cell(world.thing("stove1").tile)
    badge = pygame.Rect(0, 0, place.tile // 3, place.tile // 3)
    badge.center = (cell.x + round(0.8 * place.tile), cell.y + round(0.12 * place.tile))
    parts = []
    for step in (4, 5, 6):
        surface = pygame.Surface((640, 400))
        Painter().paint(surface, View(world, course[step], step=step))
        parts.append(pygame.image.tobytes(surface.subsurface(badge), "RGB"))
    assert len(set(parts)) == 3


def test_paused_progress_is_drawn_with_who_holds_it(play) -> None:
    world = World("asynchronous/09")
    lines = ["move table11", "pick-up-item chicken1", "move stove1", "place-item", "cook",
             "pick-up-item"]  # fmt: skip
    state = play(world, *lines)[-1]
    (row,) = state.progress()
    assert not row.running
    picture(View(world, state))


def test_painting_again_gives_the_same_picture() -> None:
    painter, view = Painter(), full_view(World("multi_agent/09"), 5)
    surfaces = [pygame.Surface((640, 400)) for _ in range(2)]
    for surface in surfaces:
        painter.paint(surface, view)
    first, second = (pygame.image.tobytes(s, "RGB") for s in surfaces)
    assert first == second


def test_one_painter_paints_several_worlds_and_sizes() -> None:
    for name, size in [("workshop/01", (500, 300)), ("multi_agent/09", (640, 480))]:
        surface = pygame.Surface(size)
        paint(surface, full_view(World(name), 2))
        assert surface.get_at((size[0] // 3, size[1] // 2)) != (0, 0, 0, 255)


@pytest.mark.parametrize("size", [(1280, 720), (801, 601)])
def test_a_tile_is_found_again(size: tuple[int, int]) -> None:
    place = layout(size, 9, 7)
    for tile in [(0, 0), (8, 6), (4, 2)]:
        cell = place.cell(tile)
        assert place.tile_at(cell.topleft) == tile
        assert place.tile_at((cell.right - 1, cell.bottom - 1)) == tile
    assert place.tile_at((place.kitchen.x - 1, 100)) is None
    assert place.tile_at((place.left, place.top - 1)) is None
    assert not place.kitchen.colliderect(place.panel)


def test_text_is_wrapped_and_cut_off() -> None:
    text = Typesetter()
    lines = text.wrap("some words and averyveryverylongword that must be broken", 14, 90, 4)
    assert len(lines) == 4
    assert lines[-1].endswith("…")
    assert all(text.width(line, 14) <= 90 for line in lines)
    assert text.wrap("", 14, 90) == ()


def test_rejections_in_words() -> None:
    def words(reason: str) -> str:
        log = ChatLog(lambda: 0.0)
        log.rejected("robot1", from_words(reason))
        return log.bubbles[0].text

    assert words("must not be: lettuce1 is cut") == "Must not be: lettuce1 is cut."
    assert words("needs: table1 has a free surface") == "Needs: table1 has a free surface."
    assert words("robot1 is busy for 2 more steps") == "Robot1 is busy for 2 more steps."
    assert Bubble.rejection("robot1", "").text


def test_lines_are_about_as_long_as_one_another() -> None:
    text = Typesetter()
    words = "needs a board, which the table is not"
    width = text.width(words, 14) - 4
    lines = text.wrap_evenly(words, 14, width, 3)
    assert len(lines) == len(text.wrap(words, 14, width, 3)) == 2
    assert " ".join(lines) == words
    assert text.width(lines[1], 14) > width // 3
    assert text.wrap_evenly("short", 14, width) == ("short",)
