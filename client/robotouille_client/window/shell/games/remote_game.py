"""A kitchen on a server, entered: connection, seat, looks."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.program import printable, tell
from robotouille_client.client import Client, connect
from robotouille_client.console.kept_seat import came_back, keep_seat, kept_seat, state_folder
from robotouille_client.game import Game
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.replay.history.live import LiveHistory
from robotouille_client.window.replay.spectator import Spectator
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.sources.remote_look import fetch_look
from robotouille_client.window.strip import Strip
from robotouille_client.window.view import Source, View

__all__ = ["PlayedSource", "Shown", "remote_game", "shown"]


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


def shown(
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
) -> AsyncIterator[tuple[Client, Game, KitchenLook | None]]:
    """Enter an episode, and come back into one's seat if one had one; the game waits for who is
    not `ready`.

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
            does = "watches" if watch else f"plays {game.seat}"
            tell(printable(f"{game.name or name} {does} in {game.code}"), err=True)
            keeping = asyncio.create_task(keep_seat(client, game, None if watch else kept))
            try:
                with TemporaryDirectory(prefix="robotouille-") as folder:
                    yield client, game, await fetch_look(client, Path(folder))
            finally:
                keeping.cancel()
