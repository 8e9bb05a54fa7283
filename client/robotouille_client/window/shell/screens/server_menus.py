"""Kitchens on a server: join one by its code, open one, look at those that there are."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.domain.loading import load_task, task_names
from robotouille.protocol.messages import Created, EpisodeInfo
from robotouille_client.client import Client
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Choice, Row, Slider, TextField, Words
from robotouille_client.window.shell.screens.play_menu import pace_words, task_title
from robotouille_client.window.shell.settings import Settings

__all__ = ["JoinMenu", "OpenMenu", "episode_words", "lobby_menu", "waiting_form"]


class JoinMenu:
    """A server, a code, a name; play or watch."""

    def __init__(self, settings: Settings, message: str = "") -> None:
        self._code = TextField("Code", settings.code, 40, "ask who opened it")
        self._server = TextField("Server", settings.server, 200)
        self._name = TextField("Your name", settings.name)
        rows = (
            self._code, Button("Play", "play"), Button("Watch", "watch"),
            self._server, self._name, Button("Back", "back"),
        )  # fmt: skip
        self.form = Form("Join by code", rows)
        self.form.message = message

    def remember(self, settings: Settings) -> None:
        """Keep what was typed for the next time."""
        settings.code = self._code.text.strip()
        settings.server = self._server.text.strip() or settings.server
        settings.name = self._name.text.strip() or settings.name


class OpenMenu:
    """A task for several people, opened on a server."""

    def __init__(self, settings: Settings, message: str = "") -> None:
        names = task_names()
        last = next((name for name in names if name.startswith(settings.task)), names[0])
        options = [(task_title(name), name) for name in names]
        self._task = Choice("Task", options, last, lambda _: self._show())
        self._goal = Words("")
        self._seats = Choice("Players", [("1", None)])
        self._rate = Slider("Pace", settings.rate, 1, 12, 1, pace_words)
        self._server = TextField("Server", settings.server, 200)
        rows = (
            Button("Open and join", "open"), self._task, self._goal, self._seats, self._rate,
            self._server, Button("Back", "back"),
        )  # fmt: skip
        self.form = Form("Open a kitchen", rows)
        self.form.message = message
        self._show()

    async def create(self, client: Client) -> Created:
        """Open what was chosen."""
        seats = {} if self._seats.value is None else {"seats": self._seats.value}
        rate = self._rate.value
        rules = {**seats, "clock": "realtime", "step_rate": rate, "timing": "people"}
        return await client.create(str(self._task.value), **rules)

    def remember(self, settings: Settings) -> None:
        """Keep what was chosen for the next time."""
        settings.server = self._server.text.strip() or settings.server
        settings.task, settings.rate = str(self._task.value), self._rate.value

    def _show(self) -> None:
        task = load_task(str(self._task.value))
        self._goal.label = task.goal_description
        counts = task.problem.seats or (task.seats,)
        self._seats.options = tuple((str(n), n) for n in counts)
        self._seats.index = min(self._seats.index, len(counts) - 1)


def lobby_menu(episodes: Iterable[EpisodeInfo], server: str) -> Form:
    """The kitchens of a server; the result is one of them, or `again`."""
    rows: list[Row] = [Button(episode_words(one), one) for one in episodes]
    if not rows:
        rows.append(Words("No kitchen is open. Open one, or ask for a code."))
    ends = (Button("Look again", "again"), Button("Back", "back"))
    form = Form("Kitchens", [*rows, *ends])
    form.message = f"On {server}"
    return form


def episode_words(episode: EpisodeInfo) -> str:
    """A kitchen in a line: its task, and who is there."""
    there = ", ".join(seat.name for seat in episode.seats if seat.name) or "nobody yet"
    free = sum(not seat.name for seat in episode.seats)
    room = f"{free} free" if free else "full: watch"
    return f"{task_title(episode.task)} · {episode.phase} · {there} · {room}"


def waiting_form(words: str) -> Form:
    """Something takes a while, and can be given up."""
    return Form(words, [Button("Cancel", "back")])
