"""Pictures that were made once, kept until they are too many, or too large together.

To count them would not be enough: in a window of 3840 x 2160 a few hundred take a gigabyte, most of
them of sizes that it had while it was resized.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from functools import wraps
from typing import ParamSpec

import pygame

__all__ = ["MAX_PICTURES", "MAX_PIXELS", "Kept", "kept"]

MAX_PICTURES = 1500

MAX_PIXELS = 32_000_000
"""Of all that is kept in one place, at 4 bytes each (128 MiB); what one frame shows takes less."""

P = ParamSpec("P")


class Kept:
    """Pictures by their keys; all are forgotten where one more would be too much."""

    def __init__(self) -> None:
        self._pictures: dict[Hashable, pygame.Surface] = {}
        self._pixels = 0

    def get(self, key: Hashable) -> pygame.Surface | None:
        """A picture that is kept; do not draw on it, it is shared."""
        return self._pictures.get(key)

    @property
    def roomy(self) -> bool:
        """Whether half of the room is left, so that pictures may be kept that nobody needs yet."""
        return 2 * len(self._pictures) < MAX_PICTURES and 2 * self._pixels < MAX_PIXELS

    def __iter__(self) -> Iterator[pygame.Surface]:
        return iter(self._pictures.values())

    def keep(self, key: Hashable, picture: pygame.Surface) -> pygame.Surface:
        """Keep a picture; the same."""
        pixels = picture.get_width() * picture.get_height()
        if len(self._pictures) >= MAX_PICTURES or self._pixels + pixels > MAX_PIXELS:
            self._pictures.clear()
            self._pixels = 0
        self._pictures[key] = picture
        self._pixels += pixels
        return picture


def kept(make: Callable[P, pygame.Surface]) -> Callable[P, pygame.Surface]:
    """A function that keeps what it makes, by its arguments, beside what others have made."""

    @wraps(make)
    def remembered(*args: P.args, **kwargs: P.kwargs) -> pygame.Surface:
        key = (make, args, *kwargs.items()) if kwargs else (make, args)
        picture = _shared.get(key)
        return _shared.keep(key, make(*args, **kwargs)) if picture is None else picture

    return remembered


_shared = Kept()
