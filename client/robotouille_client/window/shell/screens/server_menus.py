"""Kitchens on a server: join one by its code, open one, look at those that there are."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from robotouille.protocol.messages import Created, EpisodeInfo
from robotouille_client.client import Client
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.forms.widgets import Button, Row, Slider, Words
from robotouille_client.window.shell.screens.play_menu import Ask, TaskChoice, pace_words
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.sources.task_titles import task_title

__all__ = ["JoinMenu", "LobbyMenu", "OpenMenu", "episode_words", "waiting_form"]


class JoinMenu:
    """A server, a code, a name; play or watch."""

    def __init__(self, settings: Settings, message: str = "") -> None:
        self._code = TextField(
            "Code", settings.code, 40, "ask who opened it", self._changed, replaced=True
        )
        self._server = TextField("Server", settings.preferences.server, 200, changed=self._changed)
        self._name = TextField("Your name", settings.preferences.name)
        play = Button("Play", "play")
        rows = (
            self._code, play, Button("Watch", "watch"),
            self._server, self._name, Button("Back", "back"),
        )  # fmt: skip
        self.form = Form("Join by code", rows, main=play)
        self.form.message = message

    def remember(self, settings: Settings) -> None:
        """Keep what was typed for the next time."""
        settings.code = "".join(self._code.text.split())
        typed = {"server": self._server.text.strip(), "name": self._name.text.strip()}
        settings.prefer(**{field: text for field, text in typed.items() if text})

    def _changed(self, text: str) -> None:
        """What was told was about another code, or another server."""
        self.form.message = ""


class OpenMenu:
    """A task for several people, opened on a server."""

    def __init__(self, settings: Settings, message: str = "") -> None:
        self._settings = settings
        self._rate = Slider("Pace", settings.rate, 1, 12, 1, pace_words)
        self._server = TextField("Server", settings.preferences.server, 200, changed=self._changed)
        self._ends = (Button("Open and join", "open"), Button("Back", "back"))
        self._task = TaskChoice(settings, str, self._arrange)
        self.form = self._made()
        self.form.message = message

    async def ask(self, ask: Ask) -> bool:
        """Ask until a kitchen is to be opened; False to go back. What was chosen is remembered."""
        while (answer := await ask(self.form)) == "task":
            await self._task.pick(ask)
            self.form = self._made()
        self._task.remember()
        if server := self._server.text.strip():
            self._settings.prefer(server=server)
        self._settings.rate = self._rate.value
        return answer == "open"

    async def create(self, client: Client) -> Created:
        """Open what was chosen."""
        return await client.create(
            self._task.task,
            seats=self._task.seats,
            clock="realtime",
            step_rate=self._rate.value,
            timing="people",
        )

    def _made(self) -> Form:
        return Form(
            "Open a kitchen", self._rows(), pinned=1, picture=self._task.picture,
            idle=self._task.load, main=self._ends[0],
        )  # fmt: skip

    def _changed(self, text: str) -> None:
        """What was told was about another server."""
        self.form.message = ""

    def _arrange(self) -> None:
        self.form.set_rows(self._rows())

    def _rows(self) -> tuple[Row, ...]:
        start, back = self._ends
        return (start, *self._task.rows, self._rate, self._server, back)


class LobbyMenu:
    """The kitchens of a server, which can be another one; the result is one of them, or `again`.

    `own` are the codes of those in which one's seat is kept, which come first.
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
            rows.append(Words("No kitchen is open. Open one, or ask for a code."))
        self._server = TextField("Server", settings.preferences.server, 200, changed=self._changed)
        again = Button("Look again", "again")
        self._ends = (again, self._server, Button("Back", "back"))
        self.form = Form("Kitchens", [*rows, *self._ends], pinned=len(self._ends), main=again)
        self.form.message = message

    def remember(self, settings: Settings) -> None:
        """Keep the server for the next time."""
        if server := self._server.text.strip():
            settings.prefer(server=server)

    def _changed(self, text: str) -> None:
        """What was told, and the kitchens, are another server's."""
        self.form.message = ""
        self.form.set_rows(self._ends)


def episode_words(episode: EpisodeInfo, own: bool = False) -> str:
    """A kitchen in a line: its task, who is there, and whether one can play; `own` is one in which
    one's seat is kept."""
    there = ", ".join(seat.name for seat in episode.seats if seat.name) or "nobody yet"
    free = sum(not seat.name for seat in episode.seats)
    room = f"{free} free" if free else "full: watch"
    if own:
        room = "your seat is free: come back"
    return f"{task_title(episode.task)} · {episode.phase} · {there} · {room}"


def waiting_form(words: str) -> Form:
    """Something takes a while, and can be given up."""
    return Form(words, [Button("Cancel", "back")])
