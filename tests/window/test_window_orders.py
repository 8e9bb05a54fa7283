"""The slips of a shift's open orders."""

from __future__ import annotations

import pygame
import pytest
from tests.support.window_play import world_of

from robotouille import State
from robotouille.domain.rendering import rendering_of
from robotouille_client.window.drawing.side_panel.order_slips import OrderSlips
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import Colour
from robotouille_client.window.view import View

SHIFT = "shifts/01_sandwich_bar"
SIZE = (300, 700)


def with_an_order() -> State:
    state = world_of(SHIFT).initial
    while state.orders is None or not state.orders.open:
        state = state.step([]).state
    return state


class Listener(Typesetter):
    """Typesetter that keeps the lines that it draws."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def line(self, text: str, size: int, colour: Colour) -> pygame.Surface:
        self.lines.append(text)
        return super().line(text, size, colour)


def drawn(state: State, free: int, text: Typesetter | None = None) -> tuple[OrderSlips, int]:
    """Draw the slips of a state; return them with their height."""
    world, text = state.world, text or Typesetter()
    rendering = rendering_of(world.task)
    sprites = Sprites(rendering.folders(world.task.folder), text)
    resolver = AppearanceResolver(world.task.domain, rendering)
    slips = OrderSlips(View(world, state), resolver, sprites, text)
    place = layout((1280, 720), world.task.problem.width, world.task.problem.height)
    canvas = pygame.Surface(SIZE)
    return slips, slips.draw(canvas, canvas.get_rect(), place, state, free)


def test_the_layers_of_a_dish_are_listed_where_its_order_is() -> None:
    state = with_an_order()
    assert state.orders is not None
    rules = world_of(SHIFT).shift
    assert rules is not None
    dish = rules.dish_name(state.orders.open[0].number)
    filling = {"cheese sandwich": "cheese", "tomato sandwich": "cut tomato"}[dish]
    for free in (100, 600):
        slips, height = drawn(state, free)
        layers = slips.listing((20, height - 10))
        assert [words for _, words in layers] == ["bread", filling, "bread"]
        assert slips.listing((20, height + 10)) == ()


def test_slips_show_the_layers_in_words_if_there_is_room() -> None:
    state = with_an_order()
    assert drawn(state, 600)[1] > drawn(state, 100)[1]


@pytest.mark.parametrize("free", [100, 600])
def test_slips_always_name_the_layers(free: int) -> None:
    text = Listener()
    drawn(with_an_order(), free, text)
    said = ", ".join(text.lines)
    assert "bread, cheese, bread" in said or "bread, cut tomato, bread" in said
