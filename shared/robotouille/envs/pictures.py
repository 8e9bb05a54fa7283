"""Pictures of states, by the window's painter: it is above this package, so it is found by name."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import Any

from robotouille.errors import MissingExtraError
from robotouille.world.world import State

__all__ = ["picture"]

PAINTER = "robotouille_client.window.still:still"
"""A function of a state and the number of its step; it gives rows of pixels of three bytes."""


def picture(state: State, step: int) -> Any:
    """A state as an array of pixels, (height, width, 3).

    Raises:
        MissingExtraError: pygame is not installed.
    """
    try:
        still: Callable[[State, int], Any] = EntryPoint("still", PAINTER, "robotouille").load()
    except ImportError:
        raise MissingExtraError("a picture of a kitchen", "window") from None
    return still(state, step)
