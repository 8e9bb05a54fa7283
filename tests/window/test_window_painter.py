"""Painting every task at any size, with every field of a view visible."""

from __future__ import annotations

import dataclasses
import random
from functools import cache

import pygame
import pytest
from tests.support.samples import quick_sample
from tests.support.window_play import world_of

from robotouille import World, task_names
from robotouille.world.scene import scene
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.window_layout import UiOverlay, layout
from robotouille_client.window.view import Bubble, FarewellView, PauseView, SeatView, View


def picture(view: View, size=(640, 400), ui_overlay: UiOverlay | None = None) -> bytes:
    surface = pygame.Surface(size)
    Painter().paint(surface, view, ui_overlay)
    return pygame.image.tobytes(surface, "RGB")


@cache
def full_picture() -> tuple[View, bytes]:
    view = full_view(world_of("multi_agent/09"), 5)
    return view, picture(view)


def colours(pixels: bytes) -> int:
    return len({pixels[i : i + 3] for i in range(0, len(pixels), 3 * 7)})


def full_view(world: World, steps: int, seed: int = 1) -> View:
    """Return a view in the middle of a random game, with every part that a view can have."""
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


@pytest.mark.parametrize("name", quick_sample(task_names(), 3))
def test_every_task(name: str) -> None:
    view = full_view(world_of(name), 12)
    assert colours(picture(view)) > 250


@pytest.mark.parametrize(
    "change",
    quick_sample([
        {"step": 6}, {"bubbles": ()}, {"farewell": FarewellView("Out", "Gone.")},
        {"max_steps": 70}, {"clock": "lockstep"}, {"phase": 0.9}, {"me": None},
        {"chat": ()}, {"status": ""}, {"code": ""}, {"outcome": "Goal reached"},
        {"starts_in": 2.5}, {"watching": 2}, {"blocked": (("robot1", "stove1", "robot1"),)},
        {"hover": "table1"}, {"seats": ()}, {"notice": "lunch"}, {"offline": 0.5},
        {"pause": PauseView("Paused by the operator")},
    ], 3),
)  # fmt: skip
def test_every_field_changes_the_picture(change) -> None:
    view, unchanged = full_picture()
    assert picture(dataclasses.replace(view, **change)) != unchanged


def test_losing_does_not_look_like_winning() -> None:
    view = full_view(world_of("multi_agent/01"), 3)
    ended = dataclasses.replace(view, outcome="Over")
    assert picture(dataclasses.replace(ended, won=True)) != picture(ended)


@pytest.mark.parametrize("name", ["multi_agent/01", "synchronous/01"])
def test_the_outcome_covers_neither_players_nor_dishes(name: str) -> None:
    view = full_view(world_of(name), 3)
    view = dataclasses.replace(view, bubbles=(), won=True, seats=(), phase=1.0)
    ended = dataclasses.replace(view, outcome="Goal reached in 21 steps")
    size, shown = (1280, 720), []
    for each in (view, ended):
        surface = pygame.Surface(size)
        Painter().paint(surface, each)
        shown.append(surface)
    place, placed = layout(size, *_floor(view.world)), scene(view.state)
    laid = {each.host for each in placed.values() if each.host in view.world.floor.stations}
    seen = [each.tile for name, each in placed.items() if name in {*view.world.players, *laid}]
    for tile in filter(None, seen):
        before, after = (pygame.image.tobytes(s.subsurface(place.cell(tile)), "RGB") for s in shown)
        assert before == after
    assert pygame.image.tobytes(shown[0], "RGB") != pygame.image.tobytes(shown[1], "RGB")


def test_the_length_of_a_lost_connection_is_shown() -> None:
    view = full_view(world_of("multi_agent/09"), 5)
    assert len({picture(dataclasses.replace(view, offline=s)) for s in (5.0, 5.5, 6.0)}) == 2


@pytest.mark.parametrize(
    "change",
    quick_sample(
        [
            {"connected": False, "name": "", "substitute": "planner"},
            {"connected": False, "substitute": "planner"},
            {"connected": False, "name": ""},
            {"connected": False},
        ]
    ),
)
def test_who_moves_a_player_shows_at_seat_and_player(change) -> None:
    view = full_view(world_of("multi_agent/09"), 5)
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


@pytest.mark.parametrize("size", quick_sample(SIZES))
def test_interruptions_fit_any_size(size: tuple[int, int]) -> None:
    """Interruptions never cover the panel."""
    view = full_view(world_of("multi_agent/10"), 5)
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
def test_the_overlay_changes_the_picture(ui_overlay: UiOverlay) -> None:
    view = full_view(world_of("multi_agent/09"), 5)
    assert picture(view, ui_overlay=ui_overlay) != picture(view)


def test_any_text_can_be_drawn() -> None:
    view = full_view(world_of("multi_agent/09"), 1)
    nasty = "nul \0 lone \ud800 tab \t new\nline 厨房 " + "x" * 5000
    seats = tuple(dataclasses.replace(s, name=nasty, kind=nasty) for s in view.seats)
    chat = ((nasty, nasty), ("", ""))
    picture(dataclasses.replace(
        view, seats=seats, chat=chat, status=nasty, code=nasty, outcome=nasty, clock=nasty,
        bubbles=(Bubble("robot1", nasty), Bubble("robot2", ""), Bubble("nobody", "x")),
    ))  # fmt: skip


def test_progress_is_drawn_at_the_station(play) -> None:
    world = world_of("asynchronous/09")
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
