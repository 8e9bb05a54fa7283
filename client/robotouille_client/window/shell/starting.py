"""The shell of a process: its first picture at once, then all that has to be loaded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from robotouille_client.window import parse_size, require_pygame, require_screen

if TYPE_CHECKING:
    from robotouille_client.window.shell.shell import Shell

__all__ = ["open_shell"]


def open_shell(
    *,
    size: str | None = None,
    name: str | None = None,
    server: str | None = None,
    token: str | None = None,
    menu: bool = True,
    rendering: str = "",
    tasks: Path | None = None,
) -> Shell:
    """The window with what is remembered of its owner; what is given here comes first.

    Args:
        tasks: A folder of own kitchens: recordings of them are shown with its pictures.

    Raises:
        RobotouilleError: There is no screen, pygame is missing, the size is none, or the
            rendering is not there.
    """
    require_pygame()
    require_screen()
    from robotouille.domain.companions import other_renderings, shipped_rendering
    from robotouille_client.window.forms.display import Display
    from robotouille_client.window.forms.screen import Screen
    from robotouille_client.window.shell.settings import load_settings, settings_path

    if rendering:
        shipped_rendering(rendering)
    path = settings_path()
    settings, told = load_settings(path)
    look = settings.preferences.rendering
    if look and look not in other_renderings():
        told = told or f"There is no look {look!r} any more: kitchens look as usual."
        settings.prefer(rendering="")
    for_now: dict[str, object] = {}
    if size is not None:
        for_now |= {"size": parse_size(size), "fullscreen": False}
    if rendering:
        for_now["rendering"] = rendering
    if name:
        for_now["name"] = name
    if server:
        for_now["server"] = server
    remembered = settings.preferences
    settings.prefer(**for_now)
    preferences = settings.preferences
    display = Display(preferences.size, fullscreen=preferences.fullscreen)
    Screen(display).splash("Robotouille")

    from robotouille_client.window.shell.games.local_game import recordings_folder
    from robotouille_client.window.shell.shell import Shell

    shell = Shell(
        settings,
        display,
        path=path,
        remembered=remembered,
        recordings=recordings_folder(),
        tasks=tasks,
        token=token,
        menu=menu,
    )
    shell.ui.message = told or ("" if rendering else shell.ui.look_fault)
    return shell
