"""pygame window in which people play and watch."""

from __future__ import annotations

import importlib.util
import os
import re
import sys

from robotouille.errors import MissingExtraError, RobotouilleError

__all__ = ["parse_size", "require_pygame", "require_screen"]

# pygame prints a greeting on standard output, where our commands print their results.
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")


def require_pygame(what: str = "the window", extra: str = "window") -> None:
    """Raise MissingExtraError with the install command if pygame is missing."""
    if importlib.util.find_spec("pygame") is None:
        raise MissingExtraError(what, extra)


def require_screen() -> None:
    """Raise RobotouilleError if there is no screen to open a window on."""
    screen = any(os.environ.get(n) for n in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"))
    if sys.platform.startswith("linux") and not screen:
        raise RobotouilleError(
            "no screen found (DISPLAY is not set); use --screenshot FILE, or set "
            "SDL_VIDEODRIVER=dummy to run without a screen"
        )


def parse_size(size: str) -> tuple[int, int]:
    """Parse a size such as `1280x720`; raise RobotouilleError if it is invalid."""
    found = re.fullmatch("([0-9]{1,9})x([0-9]{1,9})", size, re.IGNORECASE)
    if found is None:
        raise RobotouilleError(f"invalid size {size[:40]!r}: expected WIDTHxHEIGHT, e.g. 1280x720")
    width, height = map(int, found.groups())
    if not (160 <= width <= 4096 and 120 <= height <= 4096):
        raise RobotouilleError(f"invalid size {size[:40]!r}: the limits are 160x120 and 4096x4096")
    return width, height
