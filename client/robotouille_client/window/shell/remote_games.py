"""Games on a server: join one by its code, open one, look at those that there are."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

from robotouille.errors import RobotouilleError
from robotouille_client.client import Client, connect
from robotouille_client.console import explain, server_url
from robotouille_client.window.shell.game_cards import GameCards
from robotouille_client.window.shell.games.remote_game import remote_game, shown
from robotouille_client.window.shell.screens.server_menus import JoinMenu, OpenMenu, lobby_menu
from robotouille_client.window.shell.stage import Stage

__all__ = ["RemoteGames"]

T = TypeVar("T")


class RemoteGames:
    """Plays and watches kitchens on servers.

    Args:
        token: A signed role token, where servers ask for one.
        menu: Whether there is one to go to after a game.
    """

    def __init__(self, stage: Stage, *, token: str | None, menu: bool) -> None:
        self._stage = stage
        self._token = token
        self._menu = menu

    async def choose_code(self) -> object:
        """Ask for a code, and play or watch there."""
        settings, message = self._stage.settings, ""
        while True:
            asked = JoinMenu(settings, message)
            answer = await self._stage.ask(asked.form)
            if answer == "back":
                return None
            asked.remember(settings)
            try:
                return await self.join(settings.code, watch=answer == "watch")
            except (RobotouilleError, OSError, ValueError) as error:
                message = explain(error)

    async def choose_task(self) -> object:
        """Ask for a task, open a kitchen with it, and play there."""
        settings, message = self._stage.settings, ""
        while True:
            self._stage.splash("Loading …")
            asked = OpenMenu(settings, message)
            if await self._stage.ask(asked.form) != "open":
                return None
            asked.remember(settings)
            try:
                made = await self.ask_server(asked.create)
                if made is not None:
                    settings.code = made.code
                    return await self.join(made.code)
            except (RobotouilleError, OSError, ValueError) as error:
                message = explain(error)

    async def choose_kitchen(self) -> object:
        """Ask for one of a server's kitchens, and play there if there is a free seat."""
        while True:
            episodes = await self.ask_server(lambda client: client.episodes())
            if episodes is None:
                return None
            form = lobby_menu(episodes, self._stage.settings.server)
            answer = await self._stage.ask(form)
            if answer == "back":
                return None
            if answer != "again":
                full = all(seat.name for seat in answer.seats)  # type: ignore[attr-defined]
                return await self.join(answer.code, watch=full)  # type: ignore[attr-defined]

    async def join(
        self, code: str, *, watch: bool = False, seat: str | None = None, url: str | None = None
    ) -> object:
        """Enter a kitchen and play or watch until its end, or until its owner leaves.

        Raises:
            RobotouilleError: There is no way in.
        """
        opened = remote_game(
            self._address(url), code, self._stage.settings.name, seat=seat, watch=watch,
            token=self._token,
        )  # fmt: skip
        entered = await self._stage.wait(opened.__aenter__(), "Connecting …")
        if entered is None:
            return None
        client, game, look = entered
        try:
            loop = asyncio.get_running_loop()
            source, strip = shown(game, loop.time, client.connected.is_set, look)
            buttons = [("Menu", "menu"), ("Quit", "quit")] if self._menu else [("Close", "quit")]
            cards = GameCards(lambda: game.outcome, buttons, menu=self._menu)
            caption = f"Robotouille {game.code}"
            return await self._stage.show(source, cards, caption=caption, look=look, strip=strip)
        finally:
            await opened.__aexit__(None, None, None)

    async def ask_server(
        self, ask: Callable[[Client], Awaitable[T]], url: str | None = None
    ) -> T | None:
        """Ask a server something; None where its owner gave it up.

        Raises:
            RobotouilleError: The server cannot be reached, or refuses.
        """
        address, name = self._address(url), self._stage.settings.name

        async def asked() -> T:
            async with connect(address, name=name, kind="human", token=self._token) as client:
                return await ask(client)

        return await self._stage.wait(asked(), "Connecting …")

    def _address(self, url: str | None) -> str:
        return server_url(url or self._stage.settings.server, "", 0)
