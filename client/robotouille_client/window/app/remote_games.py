"""Games on servers: join with a code, open a kitchen, or choose one."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable, Iterable, Sequence
from contextlib import AsyncExitStack
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TypeVar

from robotouille.errors import RobotouilleError
from robotouille.protocol.messages import EpisodeInfo
from robotouille.replay.rates import real_time_rate
from robotouille_client.client import Client, connect
from robotouille_client.console import explain, server_url
from robotouille_client.console.kept_seat import kept_seat, state_folder
from robotouille_client.game import Game
from robotouille_client.window.app.bot_crew import CrewOptions, bot_crew
from robotouille_client.window.app.game_cards import LEAVE_BUTTONS, REVIEW_BUTTONS, GameCards
from robotouille_client.window.app.introductions import introduction
from robotouille_client.window.app.remote_game import RemoteGame, remote_game, views_of
from robotouille_client.window.app.replays import Replays
from robotouille_client.window.app.results import note_result
from robotouille_client.window.app.server_menus import (
    JoinMenu,
    LobbyMenu,
    OpenMenu,
    waiting_form,
)
from robotouille_client.window.app.user_interface import UserInterface
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.replay.histories.live_history import LiveHistory

T = TypeVar("T")

WATCHER = "watcher"
PLAY_AGAIN = "Your team plays again. Join them!"
WATCH_AGAIN = "They play again. Watch on?"


class RemoteGames:
    """Menu entries for games on servers.

    Args:
        videos: Folder for videos; None for the current one.
        token: Signed role token for servers that require one.
        menu: True if there is a menu to return to.
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
        """Ask for a code, and play or watch that game."""
        settings, message = self._ui.settings, ""
        while True:
            menu = JoinMenu(settings, message)
            answer = await self._ui.ask(menu.form)
            menu.remember(settings)
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
            menu = OpenMenu(settings, message)
            if not await menu.ask(self._ui.ask):
                return None
            try:
                made = await self.ask_server(menu.create)
                if made is not None:
                    settings.code = made.code
                    return await self.join(made.code, bots=menu.crew)
            except (RobotouilleError, OSError, ValueError) as error:
                message = explain(error)

    async def choose_kitchen(self) -> object:
        """Let the player choose one of a server's kitchens, and play or watch there.

        The list is read again if joining fails.
        """
        settings, message = self._ui.settings, ""
        while True:
            try:
                episodes = await self.ask_server(lambda client: client.episodes())
            except (RobotouilleError, OSError, ValueError) as error:
                episodes, message = [], explain(error)
            if episodes is None:
                return None
            own = {one.code for one in episodes if self._has_kept_seat(one)}
            menu = LobbyMenu(episodes, settings, message, own)
            answer = await self._ui.ask(menu.form)
            menu.remember(settings)
            message = ""
            if answer == "back":
                return None
            if isinstance(answer, EpisodeInfo):
                full = answer.limits_sight or all(seat.name for seat in answer.seats)
                try:
                    return await self.join(answer.code, watch=full and answer.code not in own)
                except (RobotouilleError, OSError, ValueError) as error:
                    message = explain(error)

    def _has_kept_seat(self, episode: EpisodeInfo) -> bool:
        """Return whether the server keeps a seat for this player from a stopped process."""
        name = self._ui.preferences.name
        # Only an absent participant's seat can be ours. This spares reading files for most rooms.
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
        bots: CrewOptions = CrewOptions(),
    ) -> object:
        """Enter a kitchen, and play or watch there until the player leaves.

        Args:
            ready: True to be ready at once.
            bots: Bots that come along, also to the team's next kitchens.

        Raises:
            RobotouilleError: The server refused the participant.
        """
        opened = remote_game(
            self._address(url), code, self._name(watch=watch), seat=seat, watch=watch,
            token=self._token, ready=ready,
        )  # fmt: skip
        async with AsyncExitStack() as stack:
            crew = stack.enter_context(bot_crew(self._address(url), self._token, bots))
            entering = stack.enter_async_context(opened)
            entered = await self._ui.wait(entering, waiting_form("Connecting …"))
            answer: object = None if entered is None else MenuChoice.AGAIN
            while entered is not None and answer == MenuChoice.AGAIN:
                # The player comes first, and gets the best seat.
                crew.come(entered.game.code)
                answer = await self._play(entered, crew.news)
        return answer

    def _name(self, *, watch: bool) -> str:
        """Return the participant's name, or a neutral one for spectators who have not set one."""
        name = self._ui.preferences.name
        return WATCHER if watch and name == Preferences.model_fields["name"].default else name

    async def _play(
        self, entered: RemoteGame, news: Callable[[], Iterable[str]] = lambda: ()
    ) -> object:
        """Play a game and show its end card; return `again` after entering the next game.

        Args:
            news: Function that returns new lines for the chat.
        """
        loop = asyncio.get_running_loop()
        game, look = entered.game, entered.look
        source, strip, history = views_of(
            game, loop.time, entered.client.connected.is_set, look, self._ui.words, news
        )
        cards = GameCards(
            lambda: game.outcome,
            lambda: self._buttons(game, history),
            menu=self._menu,
            message=lambda: self._message(game),
            ended=partial(self._finish, game),
            start=introduction(game.world, self._ui.words, "Continue"),
        )
        caption = f"Robotouille {game.code}"
        self._ui.settings.code = game.code
        self._ui.settings.prefer(server=entered.url)
        # A server that worked is worth keeping, even if the command line named it.
        self._ui.remember("server")
        show = partial(self._ui.show, source, cards, caption=caption, look=look, strip=strip)
        try:
            answer = await show()
        finally:
            self._finish(game)
        watch = partial(self._replays.watch_seen, history, look, self._stem(game))
        save = partial(self._save, game, history, look)
        while True:
            answer = await self._replays.review(answer, cards, watch, save, show)
            if answer != MenuChoice.AGAIN:
                return answer
            try:
                ask = entered.play_again()
                made = await self._ui.wait(ask, waiting_form("Opening the kitchen …"))
                return None if made is None else answer
            except (RobotouilleError, OSError, ValueError) as error:
                cards.returned(explain(error), answer)
            answer = await show()

    def _finish(self, game: Game) -> None:
        """Forget the code of a game that has ended, and note its result."""
        if game.outcome is not None and game.own_seats:
            rate = real_time_rate(game.clock)
            seconds = None if rate is None else 1 / rate
            task, people = game.world.task, game.own_seats
            note_result(self._ui.settings, task, seconds, game.outcome, people)
            self._ui.remember()
        if game.finished and self._ui.settings.code == game.code:
            self._ui.settings.code = ""
            self._ui.remember()

    def _message(self, game: Game) -> str:
        if not (self._menu and game.rematch_code):
            return ""
        return PLAY_AGAIN if game.own_seats else WATCH_AGAIN

    def _buttons(self, game: Game, history: LiveHistory) -> Sequence[tuple[str, object]]:
        """Return the end card's buttons. Participants of a study can only close the window."""
        if not self._menu:
            return [("Close", MenuChoice.QUIT)]
        again = [("Play again", MenuChoice.AGAIN)] if game.outcome and game.own_seats else []
        if game.rematch_code and not game.own_seats:
            again = [("Watch again", MenuChoice.AGAIN)]
        of_it = REVIEW_BUTTONS if history.length > history.first else ()
        return [*again, *of_it, *LEAVE_BUTTONS]

    async def _save(self, game: Game, history: LiveHistory, look: KitchenLook | None) -> None:
        stem = self._stem(game)
        stem.parent.mkdir(parents=True, exist_ok=True)
        await self._replays.save_seen(history, look, stem.with_name(f"{stem.name}.mp4"))

    def _stem(self, game: Game) -> Path:
        """Return the path of a game's videos without the ending."""
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        # Task names contain slashes, and both names come from a server.
        name = re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{stamp}_{game.world.task.name}_{game.code}")
        return (self._videos or Path.cwd()) / name

    async def ask_server(
        self, ask: Callable[[Client], Awaitable[T]], url: str | None = None
    ) -> T | None:
        """Send a request to a server; return None if the player cancels.

        Raises:
            RobotouilleError: The server cannot be reached, or refuses the request.
        """
        address, name = self._address(url), self._ui.preferences.name

        async def asked() -> T:
            async with connect(address, name=name, kind="human", token=self._token) as client:
                return await ask(client)

        return await self._ui.wait(asked(), waiting_form("Connecting …"))

    def _address(self, url: str | None) -> str:
        return server_url(url or self._ui.preferences.server, "", 0)
