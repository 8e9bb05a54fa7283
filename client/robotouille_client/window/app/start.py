"""Start of the app: a first picture at once, then everything that takes time to load."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille_client.window import parse_size, require_pygame, require_screen

if TYPE_CHECKING:
    from robotouille_client.window.app.app import App


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
    Screen(display).splash("Robotouille")

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
