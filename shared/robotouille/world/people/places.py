"""Where stations are, in a person's words: what nobody numbers in a picture has a place in it.

Each station of a kitchen is at one of its sides or in the middle, and stands there in a row with
others that are called the same.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Literal

from robotouille.domain.rendering import PlaceWords
from robotouille.world.grounding.floor import Floor, Tile
from robotouille.world.people.templates import filled

__all__ = ["places"]

Side = Literal["top", "bottom", "left", "right", "middle"]

MAX_ASIDE = 1
"""Tiles from the edge of a kitchen up to which a station is at that side."""


def places(floor: Floor, nouns: Mapping[str, str], words: PlaceWords) -> dict[str, str]:
    """What each station is called by where it is: `the left table at the top`.

    Args:
        nouns: What stations are called, by name. No two come out the same.
    """
    called = _called(floor, nouns, words)
    if len(set(called.values())) < len(called) or not all(called.values()):
        return _called(floor, nouns, PlaceWords())  # Words that tell nothing apart.
    return called


def _called(floor: Floor, nouns: Mapping[str, str], words: PlaceWords) -> dict[str, str]:
    rows: dict[tuple[str, Side], list[str]] = defaultdict(list)
    for name, noun in nouns.items():
        rows[noun, _side(floor, floor.stations[name])].append(name)
    called: dict[str, str] = {}
    for (noun, side), names in rows.items():
        tiles = {name: floor.stations[name] for name in names}
        called.update(_row(noun, getattr(words, side), tiles, side, words))
    return called


def _side(floor: Floor, tile: Tile) -> Side:
    x, y = tile
    edges: dict[Side, int] = {
        "top": floor.height - 1 - y,
        "bottom": y,
        "left": x,
        "right": floor.width - 1 - x,
    }
    nearest = min(edges, key=lambda side: edges[side])
    return nearest if edges[nearest] <= MAX_ASIDE else "middle"


def _row(
    noun: str, at: str, tiles: Mapping[str, Tile], side: Side, words: PlaceWords
) -> dict[str, str]:
    """What the stations of one noun at one side are called."""
    if len(tiles) == 1:
        return {name: filled(words.single, noun=noun, side=at) for name in tiles}
    upright = side in ("left", "right") or _alike(x for x, _ in tiles.values())
    order = words.downwards if upright else words.across

    def along(name: str) -> Tile:
        x, y = tiles[name]
        return (-y, x) if upright else (x, -y)

    names = sorted(tiles, key=along)
    if len(names) <= len(order):
        few = order if len(names) == len(order) else (order[0], order[-1])
        return {
            name: filled(words.one_of_few, noun=noun, side=at, order=each)
            for name, each in zip(names, few, strict=True)
        }
    return {
        name: filled(words.one_of_many, noun=noun, side=at, number=words.number(index))
        for index, name in enumerate(names)
    }


def _alike(numbers: Iterable[int]) -> bool:
    return len(set(numbers)) == 1
