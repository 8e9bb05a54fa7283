"""What to play here: the task with its picture, the partners, the pace."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial

from pygame import Surface

from robotouille.domain.loading import load_task
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille.world.world import State
from robotouille_client.bots.kinds import BotKind
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Choice, Row, Slider, Words
from robotouille_client.window.shell.games.local_game import GameSetup
from robotouille_client.window.shell.screens.task_picker import TaskPicker, listed_tasks
from robotouille_client.window.shell.screens.thumbnails import Thumbnails
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.sources.task_titles import task_title

__all__ = ["Ask", "PlayMenu", "TaskChoice", "pace_words"]

Ask = Callable[[Form], Awaitable[object]]
"""Shows a form until it has a result."""

PARTNERS = (("plans ahead", BotKind.PLANNER), ("does anything", BotKind.RANDOM))


def pace_words(rate: float) -> str:
    """`5 steps a second (usual)`."""
    kind = "easy" if rate < 4 else "usual" if rate <= 6 else "hard"
    return f"{rate:g} a second ({kind})"


class TaskChoice:
    """A row for the task, which opens the list of all, one for the players, and the goal.

    `changed` is told when it is another task, or are other players. `you` tells which player is
    marked in the picture, where that is known.
    """

    def __init__(
        self,
        settings: Settings,
        words: Callable[[int], str],
        changed: Callable[[], None] = lambda: None,
        you: Callable[[State], str] | None = None,
    ) -> None:
        names = listed_tasks()
        last = next((name for name in names if name.startswith(settings.task)), names[0])
        self._settings = settings
        self._words = words
        self._changed = changed
        self._you = you
        self._pictures = Thumbnails(settings.preferences.rendering)
        options = [(task_title(name), name) for name in names]
        self._task = Choice("Task", options, last, lambda _: self._follow(), opens="task")
        self._goal = Words("")
        self._seats = Choice("Players", [("1", None)], changed=lambda _: changed())
        self._offer(settings.seats)

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows of a form; who plays alone has no choice of players."""
        several = len(self._seats.options) > 1
        return (self._task, self._goal, *([self._seats] if several else []))

    @property
    def task(self) -> str:
        """The task that is chosen."""
        return str(self._task.value)

    @property
    def seats(self) -> int:
        """How many play."""
        return int(str(self._seats.value))

    def picture(self, room: tuple[int, int]) -> Surface | None:
        """The kitchen, once it is drawn."""
        if self._you is None or self.seats == 1:
            return self._pictures.at(self.task, room)
        load = partial(load_task, self.task, seats=self.seats)
        return self._pictures.at(f"{self.task} for {self.seats}", room, load, self._you)

    def load(self) -> bool:
        """Draw the kitchen; whether it was not drawn before."""
        return self._pictures.load()

    async def pick(self, ask: Ask) -> None:
        """Let a task be chosen from the list."""
        picked = await ask(TaskPicker(self._settings, self.task).form)
        if picked != "back":
            self._task.choose(picked)
            self._follow()

    def remember(self) -> None:
        """Keep what was chosen for the next time."""
        self._settings.task, self._settings.seats = self.task, self.seats

    def _follow(self) -> None:
        self._offer(self.seats)
        self._changed()

    def _offer(self, wanted: int) -> None:
        """For how many the task is, and what is to be made."""
        task = load_task(self.task)
        self._goal.label = task.goal_description
        counts = task.problem.seats or (task.seats,)
        self._seats.options = tuple((self._words(count), count) for count in counts)
        self._seats.choose(wanted)


class PlayMenu:
    """The form, and what was chosen in it."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._partner = Choice("Partners", PARTNERS, settings.partner)
        self._rate = Slider("Pace", settings.rate, 1, 12, 1, pace_words)
        self._ends = (Button("Start", "start"), Button("Back", "back"))
        self._task = TaskChoice(settings, _company, self._arrange, seat_out_of_the_way)
        self.form = self._made()

    @property
    def setup(self) -> GameSetup:
        """What was chosen."""
        return GameSetup(
            task=self._task.task,
            seats=self._task.seats,
            partner=BotKind(str(self._partner.value)),
            rate=self._rate.value,
        )

    async def ask(self, ask: Ask) -> GameSetup | None:
        """Ask until something is to be played, which is remembered; None to go back."""
        while (answer := await ask(self.form)) == "task":
            await self._task.pick(ask)
            self.form = self._made()
        if answer != "start":
            return None
        self._task.remember()
        self._settings.partner, self._settings.rate = str(self._partner.value), self._rate.value
        return self.setup

    def _made(self) -> Form:
        return Form(
            "Play here", self._rows(), pinned=1, picture=self._task.picture, idle=self._task.load
        )

    def _arrange(self) -> None:
        self.form.set_rows(self._rows())

    def _rows(self) -> tuple[Row, ...]:
        """Who plays alone is not asked about partners."""
        start, back = self._ends
        partners = (self._partner,) if self._task.seats > 1 else ()
        return (start, *self._task.rows, *partners, self._rate, back)


def _company(seats: int) -> str:
    return {1: "you alone", 2: "you and a bot"}.get(seats, f"you and {seats - 1} bots")
