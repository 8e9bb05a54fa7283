"""What is kept of pictures is bounded, by number and by size."""

from __future__ import annotations

import pygame

from robotouille_client.window.pictures import kept as module
from robotouille_client.window.pictures.kept import MAX_PICTURES, MAX_PIXELS, Kept, kept


def test_what_was_made_is_made_once(monkeypatch) -> None:
    monkeypatch.setattr(module, "_shared", Kept())
    made = []

    @kept
    def square(side: int, *, deep: bool = False) -> pygame.Surface:
        made.append((side, deep))
        return pygame.Surface((side, side))

    assert square(3) is square(3)
    assert square(3, deep=True) is not square(3)
    assert made == [(3, False), (3, True)]


def test_large_pictures_are_forgotten_before_they_are_too_large_together() -> None:
    pictures, side = Kept(), 1000
    fitting = MAX_PIXELS // side**2
    for number in range(fitting):
        pictures.keep(number, pygame.Surface((side, side), depth=8))
    assert all(pictures.get(number) for number in range(fitting))
    newest = pictures.keep("one more", pygame.Surface((side, side), depth=8))
    assert pictures.get("one more") is newest
    assert not any(pictures.get(number) for number in range(fitting))


def test_small_pictures_are_forgotten_before_they_are_too_many() -> None:
    pictures = Kept()
    for number in range(10 * MAX_PICTURES):
        pictures.keep(number, pygame.Surface((1, 1)))
    assert 0 < sum(pictures.get(n) is not None for n in range(10 * MAX_PICTURES)) <= MAX_PICTURES


def test_one_picture_that_is_too_large_is_kept_alone() -> None:
    pictures = Kept()
    wide = pygame.Surface((MAX_PIXELS + 1, 1), depth=8)
    assert pictures.keep("wide", wide) is wide is pictures.get("wide")
    pictures.keep("small", pygame.Surface((1, 1)))
    assert pictures.get("wide") is None
