"""What is told of the thing under the mouse is beside it, and covers nothing that is in use."""

from __future__ import annotations

import dataclasses

import pygame
import pytest
from tests.support.golden_pictures import middle

from robotouille import World, load_task
from robotouille.domain.task import Timing
from robotouille_client.window.drawing.kitchen.spots import extent, occupied, player_area
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.drawing.words.placement import Label, Place, place_labels
from robotouille_client.window.view import View

ABOUT = pygame.Rect(200, 200, 60, 60)
AREA = pygame.Rect(0, 0, 600, 500)
TIP = Label("tip", (150, 30), ((0, 0),), about=ABOUT, gap=5)


def gap(one: pygame.Rect, other: pygame.Rect) -> int:
    across = max(0, one.left - other.right, other.left - one.right)
    return max(across, one.top - other.bottom, other.top - one.bottom)


def placed(*arguments, label: Label = TIP, **known) -> pygame.Rect:
    return place_labels([label], AREA, *arguments, **known)["tip"].area


def test_a_tip_is_beside_what_it_is_about_and_in_line_with_it() -> None:
    area = placed()
    assert gap(area, ABOUT) == 5
    assert area.centerx == ABOUT.centerx


def test_a_tip_covers_an_empty_floor_rather_than_anything_else() -> None:
    row = [pygame.Rect(x, 190, 60, 40) for x in (80, 140, 260, 320)]
    assert placed([], row).collidelist(row) < 0
    above = [pygame.Rect(100, 100, 260, 95)]
    assert placed([], above).top > ABOUT.bottom


def test_a_tip_covers_the_least_important_beside_it_rather_than_be_far_away() -> None:
    round_it = [ABOUT.move(x, y) for x in (-180, -120, -60, 0, 60, 120, 180)
                for y in (-180, -120, -60, 0, 60, 120, 180)]  # fmt: skip
    machines = [each for each in round_it if each.y <= ABOUT.y]
    area = placed([], round_it, machines)
    assert gap(area, ABOUT) <= ABOUT.width
    assert area.collidelist(machines) < 0
    assert gap(placed([], [], [AREA]), ABOUT) == 5


def test_a_tip_takes_a_smaller_shape_where_only_that_has_room() -> None:
    shapes = dataclasses.replace(TIP, shapes=((50, 60),))
    assert placed(label=shapes).size == (150, 30)
    walls = [pygame.Rect(0, 0, 600, 195), pygame.Rect(0, 265, 600, 235)]
    walls += [pygame.Rect(0, 0, 140, 500), pygame.Rect(320, 0, 280, 500)]
    assert placed(walls, label=shapes).size == (50, 60)


def test_a_tip_goes_farther_only_where_all_beside_it_is_in_use() -> None:
    use = [ABOUT.inflate(100, 100)]
    assert 45 <= gap(placed(use), ABOUT) <= 60
    assert gap(placed([ABOUT.inflate(300, 300)]), ABOUT) >= 150


def test_a_tip_stays_where_it_was_for_as_long_as_that_is_free() -> None:
    before = {"tip": Place(pygame.Rect(200, 300, 150, 30), (0, 100))}
    assert placed(before=before).topleft == (200, 300)
    assert placed([pygame.Rect(210, 310, 5, 5)], before=before).topleft != (200, 300)


def tip_of(view: View, size: tuple[int, int]) -> tuple[Painter, pygame.Rect]:
    painter, surface = Painter(), pygame.Surface(size)
    layout = painter.layout(size, view.world)
    tile = painter.stage(view.state).placed[view.hover or ""].tile
    assert tile is not None
    painter.paint(surface, view, UiOverlay(layout.cell(tile).center, ("Go to the table", "Now")))
    (area,) = (a for key, a in painter._labels.places().items() if key[0] == ("tip", view.hover))
    return painter, area


@pytest.mark.parametrize("size", [(640, 360), (1280, 720)])
@pytest.mark.parametrize("name", ["multi_agent/01@2", "multi_agent/07@2", "asynchronous/06"])
def test_tips_of_all_stations_are_near_them_and_cover_none_in_use(
    name: str, size: tuple[int, int]
) -> None:
    before, state, step = middle(load_task(name))
    view = View(state.world, state, before, step)
    for station in list(Painter().stage(state).stations):
        painter, area = tip_of(dataclasses.replace(view, hover=station), size)
        layout, stage = painter.layout(size, view.world), painter.stage(state)
        poses = painter._poses(view)
        about = extent(layout, stage, station, poses)
        assert about is not None
        assert gap(area, about) <= 1.5 * layout.tile, station
        assert area.collidelist(occupied(layout, stage, poses)) < 0


def test_who_is_busy_is_told_so_at_their_own_player(play) -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    before, state = play(world, "move table2")[-2:]
    view = View(world, state, before, 1, phase=0.1, me="robot1", hover="stove1")
    painter, surface = Painter(), pygame.Surface((1280, 720))
    layout = painter.layout((1280, 720), world)
    painter.paint(surface, view, UiOverlay(layout.kitchen.center, ("The stove",)))
    (told,) = (key for key in painter._labels.places() if key[0] == "busy")
    steps = state.busy_steps("robot1")
    assert told[1] == (f"You are on your way: {steps} more steps",)
    own = player_area(layout, painter._poses(view)["robot1"])
    assert gap(painter._labels.places()[told], own) <= layout.tile
    painter.paint(surface, dataclasses.replace(view, state=world.initial, previous=None))
    assert not [key for key in painter._labels.places() if key[0] == "busy"]
