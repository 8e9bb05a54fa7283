"""The pygame window: everything that draws or reads a mouse."""

from __future__ import annotations

import importlib.util

from robotouille.errors import MissingExtraError

__all__ = ["require_pygame"]


def require_pygame(what: str = "the window", extra: str = "window") -> None:
    """Raise MissingExtraError with the install line where pygame is missing."""
    if importlib.util.find_spec("pygame") is None:
        raise MissingExtraError(what, extra)
