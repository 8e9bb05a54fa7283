"""Goes from screen to screen: menu, games, end cards, and back, until its owner quits."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from robotouille.errors import RobotouilleError
from robotouille_client.bots.partner_process import PartnerProcess
from robotouille_client.bots.partners import MakePartners
from robotouille_client.console import explain
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.screen import ClosedByOwnerError
from robotouille_client.window.hands.commands import KeyMap
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.shell.local_games import LocalGames
from robotouille_client.window.shell.remote_games import RemoteGames
from robotouille_client.window.shell.replays import Replays
from robotouille_client.window.shell.screens.main_menu import menu, quit_form
from robotouille_client.window.shell.screens.settings_menu import KeysMenu, SettingsMenu
from robotouille_client.window.shell.settings import Settings, SettingsFile
from robotouille_client.window.shell.user_interface import UserInterface

__all__ = ["Shell"]


class Shell:
    """One window from its opening to its end: its `ui`, and what is shown there.

    Args:
        settings: What is remembered; `path` is where, None to remember nothing.
        recordings: Where games that are played here, and pictures, are kept; None to keep none.
        tasks: A folder of own kitchens: recordings of them are shown with its pictures.
        token: A signed role token, where servers ask for one.
        remembered: The preferences on disk, where these differ: what was said for this time only
            is not kept, unless it is changed.
        menu: Whether there is one; without it, the shell ends with what comes first.
        make_partners: The bots of games that are played here.
        clock, sleep: Injected for tests.
    """

    def __init__(
        self,
        settings: Settings,
        display: Display,
        *,
        path: Path | None = None,
        remembered: Preferences | None = None,
        recordings: Path | None = None,
        tasks: Path | None = None,
        token: str | None = None,
        menu: bool = True,
        make_partners: MakePartners = PartnerProcess,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.settings = settings
        before = settings.model_copy()
        before.preferences = remembered or settings.preferences
        file = SettingsFile(path, settings, before) if path is not None else None
        self.ui = UserInterface(
            settings, display, file=file, pictures=recordings, clock=clock, sleep=sleep
        )
        self.replays = Replays(self.ui, recordings, tasks)
        self.local = LocalGames(self.ui, self.replays, recordings, make_partners)
        self.remote = RemoteGames(self.ui, self.replays, recordings, token=token, menu=menu)
        self._menu = menu
        self._places: dict[object, Callable[[], Awaitable[object]]] = {
            Answer.PLAY: self.local.choose,
            Answer.JOIN: self.remote.choose_code,
            Answer.OPEN: self.remote.choose_task,
            Answer.LOBBY: self.remote.choose_kitchen,
            Answer.REPLAYS: self.replays.choose,
            Answer.TUTORIAL: self.local.learn,
            Answer.SETTINGS: self._set,
        }

    async def run(self, first: Coroutine[Any, Any, object] | None = None) -> None:
        """Show the menu, after what comes first, until its owner quits or closes the window."""
        try:
            self.ui.open()
            answer = await first if first is not None else None
            chosen: object = None
            while self._menu and answer != Answer.QUIT:
                if answer in self._places:
                    answer = await self._go(answer)
                elif answer == Answer.ASK_TO_QUIT:
                    answer = await self.ui.ask(quit_form())
                else:
                    asked = menu(self.settings, self.ui.take_message(), chosen)
                    answer = chosen = await self.ui.ask(asked)
        except ClosedByOwnerError:
            return  # So it ends from everywhere.
        finally:
            self.ui.remember()
            self.ui.close()

    async def _go(self, where: object) -> object:
        """Go to a place; where to go from there, None for the menu."""
        try:
            return await self._places[where]()
        except (RobotouilleError, ValidationError, OSError) as error:
            self.ui.message = explain(error)
            return None

    async def _set(self) -> object:
        self.settings.prefer(fullscreen=self.ui.display.fullscreen)
        answer: object = Answer.SETTINGS
        while answer != "back":
            asked = SettingsMenu(self.settings, self._follow)
            faults = self.ui.look_fault or self.ui.words_fault
            asked.form.message = faults or asked.form.message
            if answer == "keys":
                asked.form.focus(asked.keys)
            answer = await self.ui.ask(asked.form)
            if answer == "keys":
                await self.ui.ask(KeysMenu(self.ui.keys, self._set_keys).form)
        return None

    def _follow(self, field: str) -> str:
        """Do as a setting, which was changed, says from now on; what is wrong with it."""
        full = self.ui.preferences.fullscreen
        if field == "fullscreen" and full != self.ui.display.fullscreen:
            self.ui.display.toggle_fullscreen()
        self.ui.follow_settings()
        self.ui.remember()
        return self.ui.look_fault if field == "rendering" else self.ui.words_fault

    def _set_keys(self, keys: KeyMap) -> None:
        self.settings.prefer(keys=keys.changed)
        self.ui.follow_settings()
        self.ui.remember()
