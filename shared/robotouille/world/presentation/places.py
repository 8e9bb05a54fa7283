"""Names of stations by their place, such as `the left table at the top`.

In a picture no station has a number. Each station is at a side of the kitchen or in the middle,
in a row with the others of the same name.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from string import Formatter
from typing import Any, Literal

from robotouille.domain.rendering import PlaceWords
from robotouille.world.grounding.objects import Floor, Tile


class _PlainFormatter(Formatter):
    """Formatter for templates from servers: fields have names only.

    A width such as `{noun:>999999999}` would fill the memory.
    """

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        key = int(field_name) if field_name.isdecimal() else field_name
        return self.get_value(key, args, kwargs), key

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        if conversion:
            raise ValueError("a field has no conversion")
        return value

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec:
            raise ValueError("a field has no format")
        return str(value)


_fill = _PlainFormatter().vformat


def filled(template: str, *called: str, **words: str) -> str:
    """Fill a template. Return an empty string if it names unknown fields, or has formats."""
    try:
        return _fill(template, called, words)
    except (AttributeError, LookupError, ValueError):
        return ""


def parameters(template: str) -> set[str]:
    """Return the field names of a template; none if it is malformed."""
    try:
        return {name for _, name, _, _ in Formatter().parse(template) if name}
    except ValueError:
        return set()


def capitalised(words: str) -> str:
    """Return a text with a capital first letter."""
    return words[:1].upper() + words[1:]


Side = Literal["top", "bottom", "left", "right", "middle"]

MAX_ASIDE = 1
"""Distance in tiles from an edge within which a station belongs to that side."""


def places(floor: Floor, nouns: Mapping[str, str], words: PlaceWords) -> dict[str, str]:
    """Name each station by its place: `the left table at the top`. All names differ.

    Args:
        nouns: Nouns of the stations by object name.
    """
    called = _called(floor, nouns, words)
    if len(set(called.values())) < len(called) or not all(called.values()):
        # A language's own words may name two stations alike.
        return _called(floor, nouns, PlaceWords())
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
    """Name the stations that share a noun and a side."""
    if len(tiles) == 1:
        return {name: filled(words.single, noun=noun, side=at) for name in tiles}
    # Rows at the left and right sides, and columns in the middle, are counted from the top.
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
