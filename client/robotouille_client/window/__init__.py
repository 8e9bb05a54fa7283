"""pygame window in which people play and watch, and its start."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.errors import MissingExtraError, RobotouilleError

if TYPE_CHECKING:
    from robotouille_client.window.app.app import App

__all__ = ["StartOptions", "open_app", "parse_size", "require_pygame", "require_screen"]

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


@dataclass(frozen=True, slots=True)
class StartOptions:
    """Options of the command line, which override the remembered settings for this run.

    Attributes:
        tasks: Folder of the player's own kitchens, whose pictures replays of them use.
    """

    size: str | None = None
    name: str | None = None
    server: str | None = None
    token: str | None = None
    menu: bool = True
    rendering: str = ""
    tasks: Path | None = None


def open_app(options: StartOptions = StartOptions()) -> App:
    """Open the window with the remembered settings.

    Raises:
        RobotouilleError: There is no screen, pygame is missing, the size is invalid, or the
            rendering does not exist.
    """
    require_pygame()
    require_screen()
    from robotouille.domain.related_files import other_renderings, shipped_rendering
    from robotouille_client.window.app.settings import load_settings, settings_path
    from robotouille_client.window.forms.screen import Display, Screen

    if options.rendering:
        shipped_rendering(options.rendering)
    path = settings_path()
    settings, message = load_settings(path)
    look = settings.preferences.rendering
    if look and look not in other_renderings():
        message = message or f"The look {look!r} is not installed. Using the default look."
        settings.prefer(rendering="")
    for_now: dict[str, object] = {}
    if options.size is not None:
        for_now |= {"size": parse_size(options.size), "fullscreen": False}
    given = {"rendering": options.rendering, "name": options.name, "server": options.server}
    for_now |= {field: value for field, value in given.items() if value}
    remembered = settings.preferences
    settings.prefer(**for_now)
    preferences = settings.preferences
    display = Display(preferences.size, fullscreen=preferences.fullscreen)
    Screen(display).splash("Loading…")

    # The imports below take most of the start-up time, so the window opens before them.
    from robotouille_client.window.app.app import App, UserFiles
    from robotouille_client.window.app.local_game import recordings_folder

    app = App(
        settings,
        display,
        storage=UserFiles(path, remembered, recordings_folder(), options.tasks),
        token=options.token,
        menu=options.menu,
    )
    app.ui.message = message or ("" if options.rendering else app.ui.look_fault)
    return app
