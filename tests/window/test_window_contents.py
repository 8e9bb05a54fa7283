"""What is in a pot swims in it: in its upper part, and not beside or below it."""

from __future__ import annotations

from typing import Any

import pygame
import pytest

from robotouille import World
from robotouille.domain.rendering import rendering_of
from robotouille_client.window.drawing.kitchen.kitchen_layer import KitchenLayer
from robotouille_client.window.pictures.appearance import (
    Appearance,
    AppearanceResolver,
    SpritePiece,
)


class Whole:
    """Sprites that fill all of their square."""

    def of(self, appearance: Appearance, size: int) -> pygame.Surface:
        surface = pygame.Surface((size, size), pygame.SRCALPHA)
        surface.fill("red")
        return surface


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
@pytest.mark.parametrize("scale", [0.5, 0.78])
def test_contents_swim_in_what_holds_them(count: int, scale: float) -> None:
    world = World("asynchronous/06")
    sprites: Any = Whole()
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    potato = Appearance("potato", "item", "potato.svg")
    piece = SpritePiece("pot1", potato, scale, 0.0, (potato,) * count)
    target, tile = pygame.Surface((400, 400), pygame.SRCALPHA), 200
    KitchenLayer(world, resolver, sprites)._contents(target, piece, 200, 200, tile)
    whole = target.get_bounding_rect()
    side = round(scale * tile)
    pot = pygame.Rect(200 - side // 2, 200 - side // 2, side, side)
    assert pot.contains(whole)
    assert whole.bottom <= 200
    assert abs(whole.centerx - 200) <= 2
