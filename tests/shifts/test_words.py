"""Results of shifts in words, and the slips of the window."""

from __future__ import annotations

import pygame
import pytest

from robotouille.world.world import State, World
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.sources.texts import outcome_words, won
from robotouille_client.window.view import View
from tests.support.samples import quick_sample
from tests.support.shifts import example

WORLD = World(example())
SHIFT = {"reason": "shift_over", "steps": 600}


@pytest.mark.parametrize(
    ("points", "served", "expired", "words", "good"),
    [
        (65, 3, 0, "Shift over: 65 points, 3 orders served", True),
        (20, 1, 0, "Shift over: 20 points, 1 order served", True),
        (-10, 0, 2, "Shift over: -10 points, 0 orders served, 2 lost", False),
    ],
)
def test_result_of_a_shift(points: int, served: int, expired: int, words: str, good: bool) -> None:
    outcome = {**SHIFT, "score": {"points": points, "served": served, "expired": expired}}
    assert outcome_words(outcome) == words
    assert won(outcome) == good


def test_result_of_a_shift_without_a_score() -> None:
    assert outcome_words(SHIFT) == "Shift over after 600 steps"
    assert not won(SHIFT)


def drawn(state: State, size: tuple[int, int] = (900, 600)) -> bytes:
    surface = pygame.Surface(size)
    Painter().paint(surface, View(WORLD, state, state, 0, me="robot1"))
    return pygame.image.tobytes(surface, "RGB")


@pytest.mark.parametrize(
    "size", quick_sample((size,) for size in [(480, 360), (900, 600), (640, 1000)])
)
def test_slips_show_orders_patience_and_score(size: tuple[int, int]) -> None:
    start = WORLD.initial
    assert start.orders is not None
    rows = [
        [0, [[0, 70]], 1, 0, 0, 0],
        [0, [[0, 35]], 1, 0, 0, 0],
        [0, [[0, 70], [1, 60], [2, 50]], 3, 0, 0, 0],
        [0, [], 3, 0, 2, 1],
        [0, [[2, 70]], 3, 37, 1, 1],
    ]
    states = [WORLD.restore(start.facts, (), (), row) for row in rows]
    pictures = [drawn(state, size) for state in states]
    assert len(set(pictures)) == len(pictures)
    assert drawn(states[0], size) == pictures[0]
