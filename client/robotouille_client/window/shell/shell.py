"""Goes from screen to screen: menu, games, end cards, and back, until its owner quits."""

from __future__ import annotations

import asyncio
import dataclasses
import time
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from robotouille.domain.catalogue import task_names
from robotouille.errors import RobotouilleError
from robotouille_client.bots.partner_process import PartnerProcess
from robotouille_client.bots.partners import MakePartners
from robotouille_client.client import Client, connect
from robotouille_client.console import explain, server_url
from robotouille_client.window.forms.cards import Cards
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.screen import ClosedByOwnerError, Screen
from robotouille_client.window.hands.commands import KeyMap
from robotouille_client.window.hands.gamepad import Gamepads
from robotouille_client.window.hands.sounds import Sounds
from robotouille_client.window.shell.game_cards import GameCards, ReplayCards
from robotouille_client.window.shell.games.local_game import LocalGame, Plan
from robotouille_client.window.shell.games.remote_game import remote_game, shown
from robotouille_client.window.shell.games.tutorial import TUTORIAL, TutorialSource
from robotouille_client.window.shell.screens.main_menu import menu
from robotouille_client.window.shell.screens.play_menu import PlayMenu, task_title
from robotouille_client.window.shell.screens.replays_menu import recent_recordings, replays_menu
from robotouille_client.window.shell.screens.server_menus import (
    JoinMenu,
    OpenMenu,
    lobby_menu,
    waiting_form,
)
from robotouille_client.window.shell.screens.settings_menu import KeysMenu, SettingsMenu
from robotouille_client.window.shell.settings import Settings, save_settings
from robotouille_client.window.view import Source
from robotouille_client.window.window import Window

__all__ = ["Shell"]

T = TypeVar("T")


class Shell:
    """One window from its opening to its end.

    Args:
        settings: What is remembered; `path` is where, None to remember nothing.
        recordings: Where games that are played here are kept, None to keep none.
        tasks: A folder of own kitchens: recordings of them are shown with its pictures.
        token: A signed role token, where servers ask for one.
        remembered: What is on disk, where that differs: what was said for this time only is not
            kept, unless it is changed.
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
        remembered: Settings | None = None,
        recordings: Path | None = None,
        tasks: Path | None = None,
        token: str | None = None,
        menu: bool = True,
        make_partners: MakePartners = PartnerProcess,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.settings = settings
        self.display = display
        self.message = ""
        self._path = path
        self._remembered = remembered or settings
        self._for_now = {
            name: value for name, value in settings if value != getattr(self._remembered, name)
        }
        self._recordings = recordings
        self._tasks = tasks
        self._token = token
        self._menu = menu
        self._make_partners = make_partners
        self._clock = clock
        self._sleep = sleep
        self._gamepads = Gamepads()
        self._sounds = None if display.headless else Sounds()
        self._screen = Screen(display, gamepads=self._gamepads, sleep=sleep)
        self._follow_settings()

    async def run(self, first: Coroutine[Any, Any, object] | None = None) -> None:
        """Show the menu, after what comes first, until its owner quits or closes the window."""
        try:
            self.display.open()
            if not self.display.headless:
                self._gamepads.open()
            answer = await first if first is not None else None
            while self._menu and answer != "quit":
                answer = await self._screen.ask(menu(self.settings, self._told()))
                if answer != "quit":
                    answer = await self._go(str(answer))
        except ClosedByOwnerError:
            pass
        finally:
            self._remember()
            if self._sounds is not None:
                self._sounds.close()
            self.display.close()

    async def _go(self, where: str) -> object:
        places: dict[str, Callable[[], Awaitable[object]]] = {
            "play": self._choose_and_play,
            "join": self._join,
            "open": self._open,
            "lobby": self._lobby,
            "replays": self._replays,
            "tutorial": self.learn,
            "settings": self._set,
        }
        try:
            return await places[where]()
        except (RobotouilleError, ValidationError, OSError) as error:
            self.message = explain(error)
            return None

    def _told(self) -> str:
        words, self.message = self.message, ""
        return words

    # Games here

    async def _choose_and_play(self) -> object:
        self._screen.splash("Loading …")
        chosen = PlayMenu(self.settings)
        if await self._screen.ask(chosen.form) != "start":
            return None
        chosen.remember(self.settings)
        return await self.play(chosen.plan)

    async def play(self, plan: Plan) -> object:
        """Play a task here, again and again, or the next one, as long as that is asked for."""
        answer: object = "again"
        while answer in ("again", "next"):
            if answer == "next":
                plan = dataclasses.replace(plan, task=_following(plan.task), seats=None)
            self._screen.splash("Loading …")
            game = self._local_game(plan, self._recordings)
            answer = await self._play_once(game, plan)
        return answer

    def _local_game(self, plan: Plan, recordings: Path | None) -> LocalGame:
        return LocalGame(plan, self.settings.name, self._clock, recordings, self._make_partners)

    async def _play_once(self, game: LocalGame, plan: Plan) -> object:
        source = game.source
        buttons = [("Play again", "again"), ("Next task", "next")]
        if game.path is not None:
            buttons += [("Watch the replay", "watch"), ("Save a video", "video")]
        buttons += [("Menu", "menu"), ("Quit", "quit")]
        cards = GameCards(lambda: source.outcome, buttons, source.stand_still)
        try:
            answer = await self._show(source, cards, caption=task_title(plan.task))
        finally:
            path = game.finish(over=source.finished)
        while answer in ("watch", "video") and path is not None:
            if answer == "watch":
                await self._watch(path)
            else:
                await self._film(path)
            answer = await self._screen.ask(cards.again(self._told()))
        return answer

    async def learn(self) -> object:
        """The tutorial, and then the menu."""
        self._screen.splash("Loading …")
        game = self._local_game(TUTORIAL, None)
        source = TutorialSource(game.source, self._screen.keys)
        cards = GameCards(
            lambda: game.source.outcome,
            [("Play a game", "play"), ("The tutorial again", "tutorial"), ("Menu", "menu")],
        )
        try:
            answer = await self._show(source, cards, caption="Tutorial")
        finally:
            game.finish(over=False)
        self.settings.learned = self.settings.learned or source.finished
        return await self._go(str(answer)) if answer in ("play", "tutorial") else answer

    # Games on a server

    async def _join(self) -> object:
        message = ""
        while True:
            asked = JoinMenu(self.settings, message)
            answer = await self._screen.ask(asked.form)
            if answer == "back":
                return None
            asked.remember(self.settings)
            try:
                return await self.join(self.settings.code, watch=answer == "watch")
            except (RobotouilleError, OSError, ValueError) as error:
                message = explain(error)

    async def join(
        self, code: str, *, watch: bool = False, seat: str | None = None, url: str | None = None
    ) -> object:
        """Enter a kitchen and play or watch until its end, or until its owner leaves.

        Raises:
            RobotouilleError: There is no way in.
        """
        address = server_url(url or self.settings.server, "", 0)
        opened = remote_game(
            address, code, self.settings.name, seat=seat, watch=watch, token=self._token
        )
        entered = await self._wait(opened.__aenter__(), "Connecting …")
        if entered is None:
            return None
        client, game, look = entered
        try:
            loop = asyncio.get_running_loop()
            source, strip = shown(game, loop.time, client.connected.is_set, look)
            buttons = [("Menu", "menu"), ("Quit", "quit")] if self._menu else [("Close", "quit")]
            cards = GameCards(lambda: game.outcome, buttons, menu=self._menu)
            caption = f"Robotouille {game.code}"
            return await self._show(source, cards, caption=caption, look=look, strip=strip)
        finally:
            await opened.__aexit__(None, None, None)

    async def _open(self) -> object:
        message = ""
        while True:
            self._screen.splash("Loading …")
            asked = OpenMenu(self.settings, message)
            if await self._screen.ask(asked.form) != "open":
                return None
            asked.remember(self.settings)
            try:
                made = await self.ask_server(asked.create)
                if made is not None:
                    self.settings.code = made.code
                    return await self.join(made.code)
            except (RobotouilleError, OSError, ValueError) as error:
                message = explain(error)

    async def ask_server(
        self, ask: Callable[[Client], Awaitable[T]], url: str | None = None
    ) -> T | None:
        """Ask a server something; None where its owner gave it up.

        Raises:
            RobotouilleError: The server cannot be reached, or refuses.
        """
        address = server_url(url or self.settings.server, "", 0)

        async def asked() -> T:
            name = self.settings.name
            async with connect(address, name=name, kind="human", token=self._token) as client:
                return await ask(client)

        return await self._wait(asked(), "Connecting …")

    async def _lobby(self) -> object:
        while True:
            episodes = await self.ask_server(lambda client: client.episodes())
            if episodes is None:
                return None
            form = lobby_menu(episodes, self.settings.server)
            answer = await self._screen.ask(form)
            if answer == "back":
                return None
            if answer != "again":
                full = all(seat.name for seat in answer.seats)  # type: ignore[attr-defined]
                return await self.join(answer.code, watch=full)  # type: ignore[attr-defined]

    async def _wait(self, work: Coroutine[Any, Any, T] | Awaitable[T], words: str) -> T | None:
        """Something that takes a while; None where its owner gave it up."""
        task = asyncio.ensure_future(work)
        try:
            await self._screen.ask(waiting_form(words), until=task)
            return task.result() if task.done() else None
        finally:
            if not task.done():
                task.cancel()

    # Recordings

    async def _replays(self) -> object:
        message = ""
        while True:
            folders = [Path("recordings"), *([self._recordings] if self._recordings else [])]
            form = replays_menu(recent_recordings(folders), message)
            path = await self._screen.ask(form)
            if not isinstance(path, Path):
                return None
            try:
                await self._watch(path)
                message = ""
            except (RobotouilleError, OSError) as error:
                message = explain(error)

    async def _watch(self, path: Path) -> None:
        """Watch a recording in this window until its owner leaves it."""
        from robotouille_client.window.replay.recorded_look import open_shown
        from robotouille_client.window.replay.viewer import Viewer

        self._screen.splash("Loading …")
        recordings = [(path, open_shown(path, self._tasks, damaged=True))]
        make = partial(self._window, ReplayCards())
        viewer = Viewer(
            recordings, rendering=self.settings.rendering, now=self._clock, make_window=make
        )
        try:
            await self._watched(viewer.window, viewer)
        finally:
            viewer.close()

    async def _film(self, path: Path) -> None:
        """Save a recording as a video beside it."""
        from robotouille_client.window.replay.film import film
        from robotouille_client.window.replay.history.recorded import RecordedHistory
        from robotouille_client.window.replay.recorded_look import open_shown

        output = path.with_suffix(".mp4")
        history = RecordedHistory(open_shown(path, self._tasks))
        work = asyncio.to_thread(
            film, history, output, 5.0, "1280x720", rendering=self.settings.rendering
        )
        try:
            done = await self._wait(work, "Saving the video …")
            self.message = f"Saved {output}" if done is not None else ""
        except (RobotouilleError, OSError) as error:
            self.message = explain(error)

    # What all have in common

    async def _show(self, source: Any, cards: Cards, *, caption: str, **options: Any) -> object:
        self.display.caption = caption
        return await self._watched(self._window(cards, **options), source)

    def _window(self, cards: Cards, size: object = None, **options: Any) -> Window:
        """A window in the shell's display; sizes and captions are the display's own affair."""
        for own in ("caption", "headless", "rendering"):
            options.pop(own, None)
        return Window(
            display=self.display,
            gamepads=self._gamepads,
            cards=cards,
            sounds=self._sounds,
            keys=self._screen.keys,
            text_scale=self.settings.text_scale,
            reduced_motion=self.settings.reduced_motion,
            rendering=self.settings.rendering,
            clock=self._clock,
            sleep=self._sleep,
            **options,
        )

    async def _watched(self, window: Window, source: Source) -> object:
        """Run a window until something was chosen in it."""
        await window.run(source, linger=None)
        if self._sounds is not None:
            self.settings.sound = self._sounds.on
        if window.answer is None:
            raise ClosedByOwnerError
        return window.answer

    async def _set(self) -> object:
        form = SettingsMenu(self.settings)
        answer = await self._screen.ask(form.form)
        if answer in ("save", "keys"):
            form.apply(self.settings)
            if self.settings.fullscreen != self.display.fullscreen:
                self.display.toggle_fullscreen()
            self._follow_settings()
            self._remember()
        if answer == "keys":
            await self._set_keys()
        return None

    async def _set_keys(self) -> None:
        form = KeysMenu(self._screen.keys)
        answer = await self._screen.ask(form.form)
        if answer in ("save", "reset"):
            self.settings.keys = {} if answer == "reset" else form.keys.changed
            self._follow_settings()
            self._remember()

    def _follow_settings(self) -> None:
        self._screen.keys = KeyMap(self.settings.keys)
        self._screen.text_scale = self.settings.text_scale
        if self._sounds is not None:
            self._sounds.on = self.settings.sound

    def _remember(self) -> None:
        self.settings.size = self.display.size
        self.settings.fullscreen = self.display.fullscreen
        if self._path is not None:
            saved = self.settings.model_copy(update=self._as_before())
            self.message = save_settings(saved, self._path) or self.message

    def _as_before(self) -> dict[str, object]:
        """What was said for this time only, and has not been changed since, as it was."""
        return {
            name: getattr(self._remembered, name)
            for name, value in self._for_now.items()
            if getattr(self.settings, name) == value
        }


def _following(task: str) -> str:
    """The task after another in the list."""
    names = task_names()
    index = next((i for i, name in enumerate(names) if name.startswith(task)), -1)
    return names[(index + 1) % len(names)]
