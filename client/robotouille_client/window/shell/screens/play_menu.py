"""What to play here: the task with its picture, the partners, the pace."""

from __future__ import annotations

from robotouille.domain.loading import load_task, task_names
from robotouille_client.bots.kinds import BotKind
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Choice, Slider, Words
from robotouille_client.window.shell.games.local_game import Plan
from robotouille_client.window.shell.screens.thumbnails import thumbnail
from robotouille_client.window.shell.settings import Settings

__all__ = ["PlayMenu", "pace_words", "task_title"]

PICTURE = 300
PARTNERS = (("plans ahead", BotKind.PLANNER), ("does anything", BotKind.RANDOM))


def task_title(name: str) -> str:
    """`multi_agent/01_lettuce_burger` as `Multi agent 01: lettuce burger`."""
    folder, _, file = name.rpartition("/")
    number, _, dish = file.partition("_")
    return f"{folder} {number}: {dish}".replace("_", " ").strip().capitalize()


def pace_words(rate: float) -> str:
    """`5 steps a second (usual)`."""
    kind = "easy" if rate < 4 else "usual" if rate <= 6 else "hard"
    return f"{rate:g} a second ({kind})"


class PlayMenu:
    """The form, and what was chosen in it."""

    def __init__(self, settings: Settings) -> None:
        names = task_names()
        last = next((name for name in names if name.startswith(settings.task)), names[0])
        self._settings = settings
        self._task = Choice(
            "Task", [(task_title(name), name) for name in names], last, lambda _: self._show()
        )
        self._goal = Words("")
        self._seats = Choice("Players", [("1", None)])
        self._partner = Choice("Partners", PARTNERS, settings.partner)
        self._rate = Slider("Pace", settings.rate, 1, 12, 1, pace_words)
        rows = (
            Button("Start", "start"), self._task, self._goal, self._seats, self._partner,
            self._rate, Button("Back", "back"),
        )  # fmt: skip
        self.form = Form("Play here", rows)
        self._show()

    @property
    def plan(self) -> Plan:
        """What was chosen."""
        seats = self._seats.value
        return Plan(
            task=str(self._task.value),
            seats=seats if isinstance(seats, int) else None,
            partner=BotKind(str(self._partner.value)),
            rate=self._rate.value,
        )

    def remember(self, settings: Settings) -> None:
        """Keep what was chosen for the next time."""
        settings.task, settings.partner = str(self._task.value), str(self._partner.value)
        settings.rate, settings.seats = self._rate.value, self.plan.seats or 1

    def _show(self) -> None:
        """The task's picture and goal, and for how many it is."""
        task = load_task(str(self._task.value))
        self.form.picture = thumbnail(task.name, PICTURE, self._settings.rendering)
        self._goal.label = task.goal_description
        counts = task.problem.seats or (task.seats,)
        words = {1: "you alone", 2: "you and a bot"}
        self._seats.options = tuple((words.get(n, f"you and {n - 1} bots"), n) for n in counts)
        wanted = [n for _, n in self._seats.options]
        seats = self._settings.seats
        self._seats.index = wanted.index(seats) if seats in wanted else 0
