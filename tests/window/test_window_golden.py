"""The window looks as it did when somebody last looked at it."""

from __future__ import annotations

import pygame
import pytest
from tests.support.golden_pictures import GOLDEN, PICTURES, TOLERANCE, difference, distance
from tests.support.samples import first_quickly
from tools.contact_sheet import cells, seen_by

from robotouille import load_task
from robotouille.domain.rendering import rendering_of
from robotouille_client.window.pictures.colour_vision import DICHROMACIES, simulated


@pytest.mark.parametrize("name", first_quickly(list(PICTURES), 10))
def test_it_looks_the_same(name: str) -> None:
    found = distance(GOLDEN / f"{name}.jpg", PICTURES[name]())
    assert found < TOLERANCE, "look, then: python -m tests.support.golden_pictures"


def test_all_pictures_are_golden_and_small() -> None:
    files = {path.stem: path for path in GOLDEN.glob("*")}
    assert files.keys() == PICTURES.keys()
    assert sum(path.stat().st_size for path in files.values()) < 1_000_000


def test_a_difference_is_seen() -> None:
    first = PICTURES["multi_agent-07_onion_potato_tomato_soup"]()
    changed = first.copy()
    changed.fill("red", (100, 100, 20, 20))
    assert difference(first, first) == 0
    assert difference(first, changed) > TOLERANCE
    assert difference(first, pygame.Surface((3, 3))) == 255


def test_every_picture_of_a_rendering_is_on_the_sheet_and_there() -> None:
    task = load_task("asynchronous/10")
    shown = list(cells(task, 48))
    assert len(shown) > len(list(rendering_of(task).arts())) / 2
    for words, picture in shown:
        assert pygame.mask.from_surface(picture).count() > 3, words


@pytest.mark.parametrize("kind", DICHROMACIES)
def test_the_sheet_is_seen_as_by_others(kind: str) -> None:
    surface = pygame.Surface((4, 4))
    surface.fill((226, 80, 62))
    assert seen_by(surface, kind).get_at((1, 1))[:3] == pytest.approx(
        simulated((226, 80, 62), kind), abs=1
    )
