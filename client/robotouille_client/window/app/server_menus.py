"""Menus for kitchens on a server."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from robotouille.errors import RobotouilleError
from robotouille.protocol.messages import Created, EpisodeInfo
from robotouille_client.client import Client
from robotouille_client.window.app.bot_crew import CrewOptions
from robotouille_client.window.app.play_menu import PARTNERS, Ask, TaskChoice, pace_words
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.widgets import Button, Choice, Row, Slider, TextField, Words
from robotouille_client.window.preferences import MAX_SERVER
from robotouille_client.window.sources.texts import task_title


def _server_field(settings: Settings, changed: Callable[[str], None]) -> TextField:
    return TextField("Server", settings.preferences.server, MAX_SERVER, changed=changed)


class JoinMenu:
    """Menu for joining a kitchen with a code."""

    def __init__(self, settings: Settings, message: str = "") -> None:
        self._code = TextField(
            "Code", settings.code, 40, "ask your host for it", self._changed, replaced=True
        )
        self._server = _server_field(settings, self._changed)
        self._name = TextField("Your name", settings.preferences.name)
        play = Button("Play", "play")
        rows = (
            self._code, play, Button("Watch", "watch"),
            self._server, self._name, Button("Back", "back"),
        )  # fmt: skip
        self.form = Form("Join with a code", rows, main=play)
        self.form.message = message

    def remember(self, settings: Settings) -> None:
        """Save the entries for the next time."""
        # Codes that are copied from a message often contain spaces.
        settings.code = "".join(self._code.text.split())
        typed = {"server": self._server.text.strip(), "name": self._name.text.strip()}
        settings.prefer(**{field: text for field, text in typed.items() if text})

    def _changed(self, text: str) -> None:
        # The message was about the previous code or server.
        self.form.message = ""


class OpenMenu:
    """Menu for opening a kitchen on a server."""

    def __init__(self, settings: Settings, message: str = "") -> None:
        self._settings = settings
        self._rate = Slider("Pace", settings.rate, 1, 12, 1, pace_words)
        self._server = _server_field(settings, self._changed)
        self._bots = Choice("Bots", [("none", 0)], 0, lambda _: self._arrange())
        self._partner = Choice("They are", PARTNERS, settings.partner)
        self._ends = (Button("Open and play", "open"), Button("Back", "back"))
        self._task = TaskChoice(settings, str, self._arrange)
        self.form = self._made()
        self.form.message = message

    async def ask(self, ask: Ask) -> bool:
        """Show the menu until the player opens a kitchen; return False if they go back."""
        while (answer := await ask(self.form)) == "task":
            await self._task.pick(ask)
            self.form = self._made()
        self._task.remember()
        if server := self._server.text.strip():
            self._settings.prefer(server=server)
        self._settings.rate = self._rate.value
        if self.crew.count:
            self._settings.partner = self.crew.partner
        return answer == "open"

    @property
    def crew(self) -> CrewOptions:
        """The bots that take seats in the kitchen."""
        return CrewOptions(int(str(self._bots.value)), str(self._partner.value))

    async def create(self, client: Client) -> Created:
        """Open the chosen kitchen."""
        require_whole_kitchens(client)
        return await client.create(
            self._task.task,
            seats=self._task.seats,
            clock="realtime",
            step_rate=self._rate.value,
            timing="people",
        )

    def _made(self) -> Form:
        layout = FormLayout(self._task.picture, pinned=1)
        return Form(
            "Open a kitchen",
            self._rows(),
            layout=layout,
            idle=self._task.load,
            main=self._ends[0],
        )

    def _changed(self, text: str) -> None:
        # The message was about the previous server.
        self.form.message = ""

    def _arrange(self) -> None:
        self.form.set_rows(self._rows())

    def _rows(self) -> tuple[Row, ...]:
        start, back = self._ends
        seats = self._task.seats
        options = [(_bots_words(bots, seats), bots) for bots in range(seats)]
        chosen = min(self.crew.count, seats - 1)
        self._bots.options = tuple(options)
        self._bots.choose(chosen)
        bots = (self._bots, *((self._partner,) if chosen else ())) if seats > 1 else ()
        return (start, *self._task.rows, *bots, self._rate, self._server, back)


def _bots_words(bots: int, seats: int) -> str:
    """Return a number of bots in words, such as `1, and 2 seats for friends`."""
    free = seats - 1 - bots
    friends = f"{free} {'seat' if free == 1 else 'seats'} for friends" if free else ""
    return f"none: {friends}" if not bots else f"{bots}, and {friends}" if friends else str(bots)


class LobbyMenu:
    """List of a server's kitchens; the form's result is one of them, or `again`.

    Args:
        own: Codes of the kitchens in which a seat is kept for the player. They come first.
    """

    def __init__(
        self,
        episodes: Iterable[EpisodeInfo],
        settings: Settings,
        message: str = "",
        own: Collection[str] = (),
    ) -> None:
        ordered = sorted(episodes, key=lambda one: one.code not in own)
        rows: list[Row] = [Button(episode_words(one, one.code in own), one) for one in ordered]
        if not (rows or message):
            rows.append(Words("No kitchens yet. Open one, or ask a friend for a code."))
        self._server = _server_field(settings, self._changed)
        again = Button("Refresh", "again")
        self._ends = (again, self._server, Button("Back", "back"))
        layout = FormLayout(pinned=len(self._ends))
        self.form = Form("Kitchens", [*rows, *self._ends], layout=layout, main=again)
        self.form.message = message

    def remember(self, settings: Settings) -> None:
        """Save the server for the next time."""
        if server := self._server.text.strip():
            settings.prefer(server=server)

    def _changed(self, text: str) -> None:
        # The message and the kitchens were the previous server's.
        self.form.message = ""
        self.form.set_rows(self._ends)


def require_whole_kitchens(client: Client) -> None:
    """Check that a window can play the kitchens that a server opens.

    Raises:
        RobotouilleError: Their players see a part of the kitchen, and windows need all of it.
    """
    if client.opens_limited_sight:
        raise RobotouilleError(
            "players of this server see a part of the kitchen, and the window needs all of it; "
            "language models (robotouille-bot llm) play there"
        )


def episode_words(episode: EpisodeInfo, own: bool = False) -> str:
    """Return a line about a kitchen; `own` means that a seat is kept for the player."""
    there = ", ".join(seat.name for seat in episode.seats if seat.name) or "empty"
    free = sum(not seat.name for seat in episode.seats)
    room = f"{free} free" if free else "full (watch)"
    if episode.limits_sight:
        room = "players see a part of it (watch)"
    if own:
        room = "your seat is kept for you"
    return f"{task_title(episode.task)} · {episode.phase} · {there} · {room}"


def waiting_form(words: str) -> Form:
    """Return a form that is shown while something takes time, and that can be cancelled."""
    return Form(words, [Button("Cancel", "back")])
