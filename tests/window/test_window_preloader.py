"""Pictures are drawn before they are needed, some after each frame, and not without end."""

from __future__ import annotations

import os
from pathlib import Path

import pygame
import pytest
from benchmarks import window as bench

from robotouille_client.window.drawing.kitchen.preloader import Preloader
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures import kept
from robotouille_client.window.pictures.sprites import Sprites

SIZE = (640, 360)


@pytest.fixture(autouse=True)
def software() -> None:
    os.environ["SDL_VIDEODRIVER"] = "dummy"
    pygame.font.init()


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """What is read from files."""
    read, load = [], Sprites._load

    def counted(sprites: Sprites, name: str, size: int) -> pygame.Surface | None:
        read.append((name, size))
        return load(sprites, name, size)

    monkeypatch.setattr(Sprites, "_load", counted)
    return read


def test_a_whole_game_reads_hardly_a_file_after_its_countdown(loaded) -> None:
    painter, surface = Painter(), pygame.Surface(SIZE)
    shown = list(bench.views(bench.course(60), 4))
    painter.paint(surface, shown[0])
    painter.preload(SIZE, 60.0)
    ahead = len(loaded)
    for view in shown:
        painter.paint(surface, view)
    assert len(loaded) - ahead <= 0.1 * ahead


def test_a_slice_is_one_picture_at_least_and_the_end_is_an_end(loaded) -> None:
    painter, view = Painter(), next(bench.views(bench.course(1), 1))
    painter.preload(SIZE, 1.0)
    assert not loaded, "nothing is known of a task before its first picture"
    painter.paint(pygame.Surface(SIZE), view)
    first = len(loaded)
    for _ in range(100):  # What is known already is looked at as well.
        painter.preload(SIZE, 0.0)
    assert 1 < len(loaded) - first < 100
    painter.preload(SIZE, 60.0)
    assert len(set(loaded)) == len(loaded), "no file is read twice at one size"
    drawn = len(loaded)
    painter.preload(SIZE, 60.0)
    assert len(loaded) == drawn


def test_it_stops_where_half_of_the_room_is_taken(monkeypatch, loaded) -> None:
    monkeypatch.setattr(kept, "MAX_PICTURES", 40)
    painter, view = Painter(), next(bench.views(bench.course(1), 1))
    painter.stage(view.state)
    preloader = Preloader(view.world, painter._resolver, painter._sprites, 40)
    preloader.work(60.0)
    assert len(loaded) == 20


def test_what_is_on_its_way_has_three_sizes(loaded) -> None:
    from robotouille_client.window.drawing.kitchen.spots import Spot, sizes_of_tiles

    start, end = Spot(0.0, 0.0, 100.0), Spot(50.0, 0.0, 85.0)
    sizes = {start.towards(end, n / 100).tile for n in range(101)}
    assert sorted(sizes) == sorted(sizes_of_tiles(100))


def test_what_has_no_picture_stops_nothing(tmp_path: Path, loaded) -> None:
    view = next(bench.views(bench.course(1), 1))
    painter = Painter()
    painter.stage(view.state)
    sprites = Sprites((tmp_path,), painter.text)
    Preloader(view.world, painter._resolver, sprites, 40).work(60.0)
    assert sprites.roomy
