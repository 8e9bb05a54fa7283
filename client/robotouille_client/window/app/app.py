"""The app: it leads from the menu to games and back until the player quits."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from robotouille.errors import RobotouilleError
from robotouille_client.bots.partners import MakePartners, PartnerProcess
from robotouille_client.console import explain
from robotouille_client.window.app.local_games import LocalGames
from robotouille_client.window.app.main_menu import KeysMenu, SettingsMenu, main_menu, quit_form
from robotouille_client.window.app.remote_games import RemoteGames
from robotouille_client.window.app.replays import Replays
from robotouille_client.window.app.settings import Settings, SettingsFile
from robotouille_client.window.app.user_interface import UserInterface
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.screen import Display, WindowClosedError
from robotouille_client.window.input.commands import KeyMap
from robotouille_client.window.options import TimeSource
from robotouille_client.window.preferences import Preferences


@dataclass(frozen=True, slots=True)
class UserFiles:
    """Locations of the files that the app reads and writes.

    Attributes:
        settings: Settings file; None to remember nothing.
        remembered: Preferences in the settings file, if the current ones differ from them.
            Options of the command line are not saved unless the player changes them.
        recordings: Folder for recordings and screenshots; None to keep none.
        tasks: Folder of the player's own kitchens, whose pictures replays of them use.
    """

    settings: Path | None = None
    remembered: Preferences | None = None
    recordings: Path | None = None
    tasks: Path | None = None


class App:
    """Window with a menu, games and replays, from its opening to its end.

    Args:
        token: Signed role token for servers that require one.
        menu: True if there is a menu. Without it, the app ends after the first thing it shows.
        make_partners: Function that creates the bots of local games.
    """

    def __init__(
        self,
        settings: Settings,
        display: Display,
        *,
        storage: UserFiles = UserFiles(),
        token: str | None = None,
        menu: bool = True,
        make_partners: MakePartners = PartnerProcess,
        time_source: TimeSource = TimeSource(),
    ) -> None:
        self.settings = settings
        # The file keeps the stored preferences, so that options of one run are not written to it.
        before = settings.model_copy()
        before.preferences = storage.remembered or settings.preferences
        path, recordings = storage.settings, storage.recordings
        file = SettingsFile(path, settings, before) if path is not None else None
        self.ui = UserInterface(
            settings, display, file=file, pictures=recordings, time_source=time_source
        )
        self.replays = Replays(self.ui, recordings, storage.tasks)
        self.local = LocalGames(self.ui, self.replays, recordings, make_partners)
        self.remote = RemoteGames(self.ui, self.replays, recordings, token=token, menu=menu)
        self._menu = menu
        self._places: dict[object, Callable[[], Awaitable[object]]] = {
            MenuChoice.LEVELS: self.local.choose_level,
            MenuChoice.PLAY: self.local.choose,
            MenuChoice.JOIN: self.remote.choose_code,
            MenuChoice.OPEN: self.remote.choose_task,
            MenuChoice.LOBBY: self.remote.choose_kitchen,
            MenuChoice.REPLAYS: self.replays.choose,
            MenuChoice.TUTORIAL: self.local.learn,
            MenuChoice.SETTINGS: self._change_settings,
        }

    async def run(self, first: Coroutine[Any, Any, object] | None = None) -> None:
        """Show `first` and then the menu, until the player quits or closes the window."""
        try:
            self.ui.open()
            answer = await first if first is not None else None
            chosen: object = None
            # The answer of a game can be a menu entry: the tutorial's card leads to a local game.
            while self._menu and answer != MenuChoice.QUIT:
                if answer in self._places:
                    answer = await self._go(answer)
                elif answer == MenuChoice.ASK_TO_QUIT:
                    answer = await self.ui.ask(quit_form())
                else:
                    form = main_menu(self.settings, self.ui.take_message(), chosen)
                    answer = chosen = await self.ui.ask(form)
        except WindowClosedError:
            return
        finally:
            self.ui.remember()
            self.ui.close()

    async def _go(self, where: object) -> object:
        """Run a menu entry; return what to show next, or None for the menu."""
        try:
            return await self._places[where]()
        # A failure in one entry, such as a full disk, must not end the whole app.
        except (RobotouilleError, ValidationError, OSError) as error:
            self.ui.message = explain(error)
            return None

    async def _change_settings(self) -> object:
        # F11 may have changed the display since the settings were saved.
        self.settings.prefer(fullscreen=self.ui.display.fullscreen)
        answer: object = MenuChoice.SETTINGS
        while answer != "back":
            settings_menu = SettingsMenu(self.settings, self.apply_setting)
            faults = self.ui.look_fault or self.ui.words_fault
            settings_menu.form.message = faults or settings_menu.form.message
            if answer == "keys":
                settings_menu.form.focus(settings_menu.keys)
            answer = await self.ui.ask(settings_menu.form)
            if answer == "keys":
                await self.ui.ask(KeysMenu(self.ui.keys, self._set_keys).form)
        return None

    def apply_setting(self, field: str) -> str:
        """Apply a changed setting, and return what is wrong with it, if anything."""
        full = self.ui.preferences.fullscreen
        if field == "fullscreen" and full != self.ui.display.fullscreen:
            self.ui.display.toggle_fullscreen()
        self.ui.apply_settings()
        self.ui.remember()
        return self.ui.look_fault if field == "rendering" else self.ui.words_fault

    def _set_keys(self, keys: KeyMap) -> None:
        self.settings.prefer(keys=keys.changed)
        self.ui.apply_settings()
        self.ui.remember()
