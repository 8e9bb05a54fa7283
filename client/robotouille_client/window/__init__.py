"""The pygame window: everything that draws or reads a mouse."""

from __future__ import annotations

import importlib.util
import os
import re
import sys

from robotouille.errors import MissingExtraError, RobotouilleError

__all__ = ["parse_size", "require_pygame", "require_screen"]

# pygame greets on standard output, which belongs to our own commands.
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")


def require_pygame(what: str = "the window", extra: str = "window") -> None:
    """Raise MissingExtraError with the install line where pygame is missing."""
    if importlib.util.find_spec("pygame") is None:
        raise MissingExtraError(what, extra)


def require_screen() -> None:
    """Raise RobotouilleError where there is no screen to open a window on."""
    screen = any(os.environ.get(n) for n in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"))
    if sys.platform.startswith("linux") and not screen:
        raise RobotouilleError(
            "no screen found (DISPLAY is not set); to draw without one, see "
            "--headless and --screenshot"
        )


def parse_size(size: str) -> tuple[int, int]:
    """`1280x720` as two numbers; RobotouilleError if it is anything else."""
    found = re.fullmatch("([0-9]{1,9})x([0-9]{1,9})", size, re.IGNORECASE)
    if found is None:
        raise RobotouilleError(f"a size is WIDTHxHEIGHT, e.g. 1280x720; found {size[:40]!r}")
    width, height = map(int, found.groups())
    if not (160 <= width <= 4096 and 120 <= height <= 4096):
        raise RobotouilleError(f"a size is between 160x120 and 4096x4096; found {size[:40]!r}")
    return width, height
