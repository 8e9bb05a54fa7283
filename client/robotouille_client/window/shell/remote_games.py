"""Games on a server: join one by its code, open one, look at those that there are."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AsyncExitStack
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TypeVar

from robotouille.errors import RobotouilleError
from robotouille.protocol.message_parts import EpisodeInfo
from robotouille_client.client import Client, connect
from robotouille_client.console import explain, server_url
from robotouille_client.console.kept_seat import kept_seat, state_folder
from robotouille_client.game import Game
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.replay.history.live import LiveHistory
from robotouille_client.window.shell.game_cards import LEAVE_BUTTONS, REVIEW_BUTTONS, GameCards
from robotouille_client.window.shell.games.remote_game import RemoteGame, remote_game, views_of
from robotouille_client.window.shell.replays import Replays
from robotouille_client.window.shell.screens.server_menus import (
    JoinMenu,
    LobbyMenu,
    OpenMenu,
    waiting_form,
)
from robotouille_client.window.shell.user_interface import UserInterface

__all__ = ["RemoteGames"]

T = TypeVar("T")

WATCHER = "watcher"
PLAY_AGAIN = "The others play again: so can you."
WATCH_AGAIN = "They play again."


class RemoteGames:
    """Plays and watches kitchens on servers.

    Args:
        replays: What shows and films the games that are over.
        videos: The folder for films, None for the current one.
        token: A signed role token, where servers ask for one.
        menu: Whether there is one to go to after a game.
    """

    def __init__(
        self,
        ui: UserInterface,
        replays: Replays,
        videos: Path | None,
        *,
        token: str | None,
        menu: bool,
    ) -> None:
        self._ui = ui
        self._replays = replays
        self._videos = videos
        self._token = token
        self._menu = menu

    async def choose_code(self) -> object:
        """Ask for a code, and play or watch there."""
        settings, message = self._ui.settings, ""
        while True:
            asked = JoinMenu(settings, message)
            answer = await self._ui.ask(asked.form)
            asked.remember(settings)
            if answer == "back":
                return None
            try:
                return await self.join(settings.code, watch=answer == "watch")
            except (RobotouilleError, OSError, ValueError) as error:
                message = explain(error)

    async def choose_task(self) -> object:
        """Ask for a task, open a kitchen with it, and play there."""
        settings, message = self._ui.settings, ""
        while True:
            self._ui.splash("Loading …")
            asked = OpenMenu(settings, message)
            if not await asked.ask(self._ui.ask):
                return None
            try:
                made = await self.ask_server(asked.create)
                if made is not None:
                    settings.code = made.code
                    return await self.join(made.code)
            except (RobotouilleError, OSError, ValueError) as error:
                message = explain(error)

    async def choose_kitchen(self) -> object:
        """Ask for one of a server's kitchens, and play there if there is a free seat; where there
        is no way in any more, they are read anew."""
        settings, message = self._ui.settings, ""
        while True:
            try:
                episodes = await self.ask_server(lambda client: client.episodes())
            except (RobotouilleError, OSError, ValueError) as error:
                episodes, message = [], explain(error)
            if episodes is None:
                return None
            own = {one.code for one in episodes if self._has_kept_seat(one)}
            asked = LobbyMenu(episodes, settings, message, own)
            answer = await self._ui.ask(asked.form)
            asked.remember(settings)
            message = ""
            if answer == "back":
                return None
            if isinstance(answer, EpisodeInfo):
                full = all(seat.name for seat in answer.seats)
                try:
                    return await self.join(answer.code, watch=full and answer.code not in own)
                except (RobotouilleError, OSError, ValueError) as error:
                    message = explain(error)

    def _has_kept_seat(self, episode: EpisodeInfo) -> bool:
        """Whether a seat is kept there for a window of this name whose process stopped."""
        name = self._ui.preferences.name
        if all(seat.present or not seat.name for seat in episode.seats):
            return False
        with kept_seat(state_folder(), self._address(None), episode.code, name) as kept:
            return kept is not None and kept.token is not None

    async def join(
        self,
        code: str,
        *,
        watch: bool = False,
        seat: str | None = None,
        url: str | None = None,
        ready: bool = False,
    ) -> object:
        """Enter a kitchen and play or watch until its end, again and again as long as that is asked
        for, or until its owner leaves.

        Args:
            ready: Whether the game need not wait until its owner says so.

        Raises:
            RobotouilleError: There is no way in.
        """
        opened = remote_game(
            self._address(url), code, self._name(watch=watch), seat=seat, watch=watch,
            token=self._token, ready=ready,
        )  # fmt: skip
        async with AsyncExitStack() as stack:
            entering = stack.enter_async_context(opened)
            entered = await self._ui.wait(entering, waiting_form("Connecting …"))
            answer: object = None if entered is None else Answer.AGAIN
            while entered is not None and answer == Answer.AGAIN:
                answer = await self._play(entered)
        return answer

    def _name(self, *, watch: bool) -> str:
        """What one is called; who has chosen no name, and only watches, is no player."""
        name = self._ui.preferences.name
        return WATCHER if watch and name == Preferences.model_fields["name"].default else name

    async def _play(self, entered: RemoteGame) -> object:
        """A game, and what comes after it: `again` where one has entered the next."""
        loop = asyncio.get_running_loop()
        game, look = entered.game, entered.look
        source, strip, history = views_of(
            game, loop.time, entered.client.connected.is_set, look, self._ui.words
        )
        cards = GameCards(
            lambda: game.outcome,
            lambda: self._buttons(game, history),
            menu=self._menu,
            news=lambda: self._news(game),
            ended=partial(self._forget, game),
        )
        caption = f"Robotouille {game.code}"
        self._ui.settings.code = game.code
        self._ui.settings.prefer(server=entered.url)
        self._ui.remember("server")
        show = partial(self._ui.show, source, cards, caption=caption, look=look, strip=strip)
        try:
            answer = await show()
        finally:
            self._forget(game)
        watch = partial(self._replays.watch_seen, history, look, self._stem(game))
        save = partial(self._save, game, history, look)
        while True:
            answer = await self._replays.review(answer, cards, watch, save, show)
            if answer != Answer.AGAIN:
                return answer
            try:
                ask = entered.play_again()
                made = await self._ui.wait(ask, waiting_form("Opening the kitchen …"))
                return None if made is None else answer
            except (RobotouilleError, OSError, ValueError) as error:
                cards.came_back(explain(error), answer)
            answer = await show()

    def _forget(self, game: Game) -> None:
        """The code of a game that is over leads nowhere any more."""
        if game.over and self._ui.settings.code == game.code:
            self._ui.settings.code = ""
            self._ui.remember()

    def _news(self, game: Game) -> str:
        if not (self._menu and game.rematch_code):
            return ""
        return PLAY_AGAIN if game.own_seats else WATCH_AGAIN

    def _buttons(self, game: Game, history: LiveHistory) -> Sequence[tuple[str, object]]:
        """What comes next; a study's window can only be closed."""
        if not self._menu:
            return [("Close", Answer.QUIT)]
        again = [("Play again", Answer.AGAIN)] if game.outcome and game.own_seats else []
        if game.rematch_code and not game.own_seats:
            again = [("Watch again", Answer.AGAIN)]
        of_it = REVIEW_BUTTONS if history.length > history.first else ()
        return [*again, *of_it, *LEAVE_BUTTONS]

    async def _save(self, game: Game, history: LiveHistory, look: KitchenLook | None) -> None:
        stem = self._stem(game)
        stem.parent.mkdir(parents=True, exist_ok=True)
        await self._replays.save_seen(history, look, stem.with_name(f"{stem.name}.mp4"))

    def _stem(self, game: Game) -> Path:
        """The path of videos of a game, without the ending."""
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        name = re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{stamp}_{game.world.task.name}_{game.code}")
        return (self._videos or Path.cwd()) / name

    async def ask_server(
        self, ask: Callable[[Client], Awaitable[T]], url: str | None = None
    ) -> T | None:
        """Ask a server something; None where its owner gave it up.

        Raises:
            RobotouilleError: The server cannot be reached, or refuses.
        """
        address, name = self._address(url), self._ui.preferences.name

        async def asked() -> T:
            async with connect(address, name=name, kind="human", token=self._token) as client:
                return await ask(client)

        return await self._ui.wait(asked(), waiting_form("Connecting …"))

    def _address(self, url: str | None) -> str:
        return server_url(url or self._ui.preferences.server, "", 0)
