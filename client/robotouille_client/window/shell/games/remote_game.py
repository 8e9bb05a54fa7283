"""A kitchen on a server, entered: connection, seat, looks."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.errors import RobotouilleError
from robotouille.program import printable, tell
from robotouille_client.client import Client, connect
from robotouille_client.console.kept_seat import (
    KeptSeat,
    came_back,
    keep_seat,
    kept_seat,
    state_folder,
)
from robotouille_client.game import Game
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.replay.history.live import LiveHistory
from robotouille_client.window.replay.spectator import Spectator
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.sources.remote_look import fetch_look
from robotouille_client.window.strip import Strip
from robotouille_client.window.view import Source, View

__all__ = ["PlayedSource", "RemoteGame", "Shown", "remote_game", "views_of"]

LEAVE_SECONDS = 2.0
"""For which whoever leaves waits for the server's answer."""


class PlayedSource(RemoteSource):
    """A game that one plays, and the `history` of what one has seen of it."""

    def __init__(
        self,
        game: Game,
        now: Callable[[], float],
        connected: Callable[[], bool],
        language: Language | None,
    ) -> None:
        self.history = LiveHistory(game, now, language)
        super().__init__(game, now, connected, language, self.history.observe)

    def view(self) -> View:
        view = super().view()
        self.history.sit(view.seats)
        return view


class Shown(NamedTuple):
    """What a window shows of a game, the strip below it, and what has been seen of it so far."""

    source: Source
    strip: Strip | None
    history: LiveHistory


def views_of(
    game: Game,
    now: Callable[[], float],
    connected: Callable[[], bool],
    look: KitchenLook | None,
    words: Language = NO_WORDS,
) -> Shown:
    """What there is to show, with `words` of one's own; who only watches has a timeline."""
    own = language_of(game.world.task) if look is None else look.rendering.language
    language = own.with_words(words)
    if game.own_seats:
        played = PlayedSource(game, now, connected, language)
        return Shown(played, None, played.history)
    watched = Spectator(game, now, connected, language)
    return Shown(watched, watched.strip, watched.history)


class RemoteGame:
    """A kitchen on a server that one has entered: its connection, its `game`, its `look`.

    `kept` is what brings its owner back whose process stops; it is kept by the `url` and `name`.
    """

    def __init__(
        self, client: Client, game: Game, look: KitchenLook | None, url: str, name: str
    ) -> None:
        self.client = client
        self.game = game
        self.look = look
        self.url = url
        self._name = name
        self._kept: KeptSeat | None = None
        self._keeping = ExitStack()

    def keep(self, kept: KeptSeat | None) -> None:
        """Write down what brings one back, until `close`."""
        self._kept = kept
        task = asyncio.create_task(keep_seat(self.client, self.game, kept))
        self._keeping.callback(task.cancel)

    async def play_again(self) -> Game:
        """Enter the game in which the team meets once this one is over; who has only watched
        watches that, as soon as it has a `rematch_code`.

        Raises:
            RobotouilleError: There is no way in.
        """
        if plays := bool(self.game.own_seats):
            game = await self.client.rematch(ready=False)
        else:
            code = self.game.rematch_code
            await self.client.leave()
            game = await self.client.join(code, role="spectator")
        self.game = game
        self.close()
        seat = kept_seat(state_folder(), self.url, game.code, self._name)
        self.keep(self._keeping.enter_context(seat) if plays else None)
        _tell_entered(game, self._name)
        return game

    async def leave(self) -> None:
        """Give one's seat up, so that nobody waits for one; where there is no connection, it is
        kept for a while as if that had been lost."""
        if self.game.ended or not self.client.connected.is_set():
            return
        with contextlib.suppress(RobotouilleError, TimeoutError):
            await asyncio.wait_for(self.client.leave(), LEAVE_SECONDS)
            if self._kept is not None:
                self._kept.forget()
            self._kept = None

    def close(self) -> None:
        """Write nothing down any more."""
        self._keeping.close()


@asynccontextmanager
async def remote_game(
    url: str,
    code: str,
    name: str,
    *,
    seat: str | None = None,
    watch: bool,
    token: str | None,
    ready: bool = True,
) -> AsyncIterator[RemoteGame]:
    """Enter an episode, and come back into one's seat if one had one; the game waits for who is
    not `ready`. Whoever is done with it leaves it; a window that is closed and a process that is
    stopped keep their seat, as if the connection were lost.

    Raises:
        RobotouilleError: There is no way in; its words say why.
    """
    role: Literal["player", "spectator"] = "spectator" if watch else "player"
    with kept_seat(state_folder(), url, code, name) as kept:
        asked = (seat,) if seat is not None else ()
        resume = kept.token_for(asked) if kept is not None and not watch else None
        async with connect(url, name=name, kind="human", token=token, resume=resume) as client:
            game = await client.join(code, seat=seat, role=role, ready=ready or watch)
            if not watch and (back := came_back(client, game, kept)):
                tell(printable(f"came back into {back}"), err=True)
            _tell_entered(game, name)
            with TemporaryDirectory(prefix="robotouille-") as folder:
                look = await fetch_look(client, Path(folder))
                entered = RemoteGame(client, game, look, url, name)
                entered.keep(None if watch else kept)
                try:
                    yield entered
                    await entered.leave()
                finally:
                    entered.close()


def _tell_entered(game: Game, name: str) -> None:
    does = f"plays {game.seat}" if game.own_seats else "watches"
    tell(printable(f"{game.name or name} {does} in {game.code}"), err=True)
