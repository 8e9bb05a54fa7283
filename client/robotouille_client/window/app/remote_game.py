"""A participant's game on a server: its connection, seat and look."""

from __future__ import annotations

import asyncio
import base64
import binascii
import contextlib
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

from robotouille.domain.json_files import validate
from robotouille.domain.pictures import (
    MAX_PICTURE_BYTES,
    PictureError,
    picture_digest,
    plain_picture,
)
from robotouille.domain.rendering import NO_WORDS, Language, RenderingFile, language_of
from robotouille.domain.schema import InputFile
from robotouille.errors import FileError, ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.terminal import printable, tell
from robotouille_client.client import Client, connect
from robotouille_client.console.kept_seat import (
    KeptSeat,
    came_back,
    keep_seat,
    kept_seat,
    state_folder,
)
from robotouille_client.game import Game
from robotouille_client.window.drawing.window_layout import Strip
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.replay.histories.live_history import LiveHistory
from robotouille_client.window.replay.viewer import SpectatorSource
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.view import GameSource, View

MAX_PICTURES = 500
WAIT_SECONDS = 5.0
"""Time limit for the rendering; the game does not wait longer for its look."""
AGAIN_SECONDS = 1.0
MAX_TRIES = 10


async def fetch_look(client: Client, folder: Path) -> KitchenLook | None:
    """Return the kitchen's look; None if it is a shipped one or the server has none.

    Pictures are written to a folder. Invalid pictures are skipped.
    """
    try:
        found = await asyncio.wait_for(client.rendering(), WAIT_SECONDS)
        if found.rendering is None:
            return None
        rendering = validate(found.rendering, RenderingFile, "rendering")
        bindings = validate(found.bindings or {}, InputFile, "bindings")
    except FileError as error:
        tell(f"ignored the kitchen's rendering: {len(error.faults)} errors", err=True)
        return None
    except (RobotouilleError, TimeoutError):
        return None
    wanted = {name: found.pictures[name] for name in rendering.files() if name in found.pictures}
    for name, digest in sorted(wanted.items())[:MAX_PICTURES]:
        try:
            # Pictures come from another machine, so they are checked before anything reads them.
            content = _checked(name, await _fetch_picture(client, digest), digest)
        except RobotouilleError as error:
            tell(printable(f"picture {name}: {error}"), err=True)
            continue
        # A slow disk must not block the event loop, which also serves the connection.
        await asyncio.to_thread((folder / name).write_bytes, content)
    return KitchenLook(rendering, bindings, folder)


async def _fetch_picture(client: Client, digest: str) -> messages.Picture:
    # The server limits how many pictures a client may request at once.
    for _ in range(MAX_TRIES):
        try:
            return await client.picture(digest)
        except ProtocolError as error:
            if error.code != "rate/limited":
                raise
            await asyncio.sleep(AGAIN_SECONDS)
    raise PictureError("the server is too busy")


def _checked(name: str, picture: messages.Picture, digest: str) -> bytes:
    # Base64 has four letters for three bytes.
    if len(picture.data) > MAX_PICTURE_BYTES * 4 // 3 + 4:
        raise PictureError("is too large")
    try:
        content = base64.b64decode(picture.data, validate=True)
    except (binascii.Error, ValueError):
        raise PictureError("is not valid Base64") from None
    if picture_digest(content) != digest:
        raise PictureError("does not match its digest")
    return plain_picture(name, content)


LEAVE_SECONDS = 2.0
"""Time for which leaving waits for the server's answer."""


class PlayedSource(RemoteSource):
    """Source for a participant with a seat, which records a `history` for the replay."""

    def __init__(
        self,
        game: Game,
        now: Callable[[], float],
        connected: Callable[[], bool],
        language: Language | None,
        news: Callable[[], Iterable[str]] = lambda: (),
    ) -> None:
        self.history = LiveHistory(game, now, language)
        super().__init__(game, now, connected, language, self.history.observe, news)

    def view(self) -> View:
        view = super().view()
        self.history.set_seats(view.seats)
        return view


class GameViews(NamedTuple):
    """Source, strip and history of a game in a window."""

    source: GameSource
    strip: Strip | None
    history: LiveHistory


def views_of(
    game: Game,
    now: Callable[[], float],
    connected: Callable[[], bool],
    look: KitchenLook | None,
    words: Language = NO_WORDS,
    news: Callable[[], Iterable[str]] = lambda: (),
) -> GameViews:
    """Return what the window shows of a game. Spectators have a timeline in the strip.

    Args:
        news: Function that returns new lines for a player's chat.
    """
    own = language_of(game.world.task) if look is None else look.rendering.language
    language = own.with_words(words)
    if game.own_seats:
        played = PlayedSource(game, now, connected, language, news)
        return GameViews(played, None, played.history)
    watched = SpectatorSource(game, now, connected, language)
    return GameViews(watched, watched.strip, watched.history)


class RemoteGame:
    """Entered game: its connection, state and look.

    It keeps a note on disk with which a stopped process can return to its seat.
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
        """Write the note for returning, until `close`."""
        self._kept = kept
        task = asyncio.create_task(keep_seat(self.client, self.game, kept))
        self._keeping.callback(task.cancel)

    async def play_again(self) -> Game:
        """Enter the team's next game. Spectators watch it, once it has a `rematch_code`.

        Raises:
            RobotouilleError: The server refused the participant.
        """
        # A rematch leads the whole team to one kitchen, whoever asks first.
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
        _print_entered(game, self._name)
        return game

    async def leave(self) -> None:
        """Give up the seat, so that nobody waits for it.

        Without a connection, the server keeps the seat for a while.
        """
        if self.game.ended or not self.client.connected.is_set():
            return
        with contextlib.suppress(RobotouilleError, TimeoutError):
            await asyncio.wait_for(self.client.leave(), LEAVE_SECONDS)
            if self._kept is not None:
                self._kept.forget()
            self._kept = None

    def close(self) -> None:
        """Stop writing the note for returning."""
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
    """Enter an episode, or return to the participant's seat in it.

    The participant leaves the episode at the end. If the window is closed or the process stops, the
    server keeps the seat, as after a lost connection.

    Raises:
        RobotouilleError: The server refused the participant.
    """
    role: Literal["player", "spectator"] = "spectator" if watch else "player"
    with kept_seat(state_folder(), url, code, name) as kept:
        asked = (seat,) if seat is not None else ()
        # A spectator must not take the seat that a stopped process left behind.
        resume = kept.token_for(asked) if kept is not None and not watch else None
        async with connect(url, name=name, kind="human", token=token, resume=resume) as client:
            game = await client.join(code, seat=seat, role=role, ready=ready or watch)
            if not watch and (back := came_back(client, game, kept)):
                tell(printable(f"returned to {back}"), err=True)
            _print_entered(game, name)
            # The pictures belong to one server's kitchen, so they are deleted after the game.
            with TemporaryDirectory(prefix="robotouille-") as folder:
                look = await fetch_look(client, Path(folder))
                entered = RemoteGame(client, game, look, url, name)
                entered.keep(None if watch else kept)
                try:
                    yield entered
                    await entered.leave()
                finally:
                    entered.close()


def _print_entered(game: Game, name: str) -> None:
    does = f"plays {game.seat}" if game.own_seats else "watches"
    tell(printable(f"{game.name or name} {does} in {game.code}"), err=True)
