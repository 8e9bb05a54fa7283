"""How wide strokes of a vector picture may be: round ones take as long to draw as they are wide.

What is worked out is a bound from above, since attributes are inherited and styles replace them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from robotouille.domain.pictures.png import PictureError

__all__ = ["Strokes"]

MAX_WIDTH = 4.0
"""Widths of the picture."""
UNIT = 100.0
"""Pixels that a unit of CSS has at most, an inch having 96."""
TRANSFORM = re.compile(
    r"\s*+(?:(?:matrix|translate|scale|rotate|skewX|skewY)\s*+\([^()]*+\)[\s,]*+)*+"
)
"""What is written otherwise, windows read in ways of their own. Possessive: linear on any text."""
FUNCTION = re.compile(r"([a-zA-Z]++)\s*+\(([^()]*+)\)")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
STYLE_WIDTH = re.compile(r"stroke-width\s*:([^;]*)")


class Strokes:
    """Looks at the elements of a picture as they begin and end."""

    def __init__(self) -> None:
        self._side = 0.0
        self._widest = 1.0  # What has no width of its own.
        self._scales = [1.0]
        self._largest = 1.0

    def begin(self, attributes: Mapping[str, str]) -> None:
        """An element; PictureError where strokes may be too wide, or the picture has no size."""
        if not self._side:
            self._side = _side(attributes)
        self._scales.append(self._scales[-1] * _scale(attributes.get("transform", "")))
        self._largest = max(self._largest, self._scales[-1])
        for text in (
            attributes.get("stroke-width", ""),
            *STYLE_WIDTH.findall(attributes.get("style", "")),
        ):
            self._widest = max(self._widest, _length(text))
        if not self._widest * self._largest <= MAX_WIDTH * self._side:
            raise PictureError(f"may have strokes more than {MAX_WIDTH:g} times as wide as it is")

    def end(self) -> None:
        """The newest element that has begun."""
        self._scales.pop()


def _side(attributes: Mapping[str, str]) -> float:
    """The shorter side of a picture, in its own units."""
    numbers = _numbers(attributes.get("viewBox", ""))[2:4]
    if len(numbers) < 2:
        numbers = [
            float(found[0])
            for name in ("width", "height")
            if (found := NUMBER.match(attributes.get(name, "").strip()))
        ]
    if len(numbers) < 2 or not 0 < min(numbers) < math.inf:
        raise PictureError("has neither a viewBox nor a width and a height")
    return min(numbers)


def _scale(transform: str) -> float:
    """By how much a transformation enlarges, at most; PictureError if it is none."""
    if not TRANSFORM.fullmatch(transform):
        raise PictureError(f"has a transformation that is none: {transform[:40]!r}")
    factor = 1.0
    for name, arguments in FUNCTION.findall(transform):
        numbers = [abs(number) for number in _numbers(arguments)]
        if name == "scale":
            factor *= max(1.0, *numbers[:2], 0.0)
        elif name == "matrix":
            factor *= max(1.0, 2 * max(numbers[:4], default=0.0))
        elif name.startswith("skew") and numbers:
            factor *= 1 + abs(math.tan(math.radians(numbers[0] % 360)))
    return factor


def _length(text: str) -> float:
    """A width in pixels, at most; 0 where there is none."""
    found = NUMBER.match(text.strip())
    if found is None:
        return 0.0
    bare = found.end() == len(text.strip())
    return abs(float(found[0])) * (1.0 if bare or text.strip().endswith("px") else UNIT)


def _numbers(text: str) -> list[float]:
    return [float(number) for number in NUMBER.findall(text)]
