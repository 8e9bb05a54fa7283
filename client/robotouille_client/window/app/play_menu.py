"""Menu for a game: the task with its picture, the players and the pace."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from functools import lru_cache, partial

from pygame import Surface

from robotouille.certification.stars import limits_of, score_limits
from robotouille.certification.step_limit import retimed_length
from robotouille.domain.loading import load_task, task_names
from robotouille.domain.task import Task, Timing
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille.world.world import State
from robotouille_client.window.app.local_game import GameSetup
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.app.thumbnails import Thumbnails
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.picker import EntryText, Picker, PickerEntry
from robotouille_client.window.forms.widgets import Button, Choice, Row, Slider, Words
from robotouille_client.window.sources.texts import (
    dish_title,
    family_title,
    rate_words,
    task_title,
)

FIRST_FAMILIES = ("training", "shifts", "synchronous", "asynchronous", "multi_agent")
"""Families from easy to hard; others follow them."""


class TaskPicker:
    """List of tasks; the form's result is a task's name, or `back`."""

    def __init__(self, settings: Settings, chosen: str) -> None:
        self._best = settings.best
        self._rate = settings.rate
        self._pictures = Thumbnails(settings.preferences.rendering)
        self._lengths: dict[str, int | None] = {}
        self._wanted: dict[str, None] = {}
        self.form = Picker(
            "Choose a task",
            [self._entry(name) for name in listed_tasks()],
            [Button("Back", "back")],
            chosen=chosen,
            idle=self._load,
        )

    def _entry(self, name: str) -> PickerEntry:
        return PickerEntry(
            name,
            lambda: EntryText(_dish(name), self._detail(name)),
            group=family_title(name),
            also=name.partition("/")[0].replace("_", " "),
            picture=lambda room: self._pictures.at(name, room),
            about=lambda: self._about(name),
        )

    def _detail(self, name: str) -> str:
        """Return the line below a task: its players, the steps of three stars, the best game."""
        task = _task(name)
        words = [players_words(task)]
        shift = task.problem.shift is not None
        scores = score_limits(task.problem, task.seats)
        length = None if shift else self._length(name)
        if scores is not None:
            words.append(f"3 stars: {scores.three} points")
        if length is not None:
            words.append(f"3 stars: {limits_of(length, self._rate).three} steps")
        best = best_of(self._best, name, most=shift)
        if best is not None:
            words.append(f"your best {best}")
        return " · ".join(words)

    def _about(self, name: str) -> str:
        """Return the goal, the steps of three stars and of the known plan, and the best game."""
        task = _task(name)
        words = [task.goal_description]
        if task.problem.shift is not None:
            words.append("Orders keep coming: earn as many points as you can.")
            for seats in task.problem.seats or (task.seats,):
                scores = score_limits(task.problem, seats)
                if scores is not None:
                    who = "1 player" if seats == 1 else f"{seats} players"
                    words.append(f"Stars with {who}: {scores.one}, {scores.two}, {scores.three}.")
            best = best_of(self._best, name, most=True)
            words.append("Not played yet." if best is None else f"Your best: {best} points.")
            return "\n".join(words)
        length, best = self._length(name), best_of(self._best, name)
        if length is not None:
            three = limits_of(length, self._rate).three
            words.append(f"Three stars need at most {three} steps. Best known: {length}.")
        words.append("Not solved yet." if best is None else f"Your best: {best} steps.")
        return "\n".join(words)

    def _length(self, name: str) -> int | None:
        """Return the length of a good game; None if it is unknown or not computed yet."""
        if name not in self._lengths:
            # Reinserting moves the name to the end, from which `_load` takes the next one.
            self._wanted.pop(name, None)
            self._wanted[name] = None
        return self._lengths.get(name)

    def _load(self) -> bool:
        """Draw a picture or else compute a length, the last requested first."""
        # Pictures come first: lengths of large tasks take seconds, and the list would stay blank.
        if self._pictures.load():
            return True
        if not self._wanted:
            return False
        name, _ = self._wanted.popitem()
        # Retiming a plan simulates it, which is too slow for every entry at once.
        self._lengths[name] = retimed_length(load_task(name, timing=Timing.PEOPLE))
        return True


def listed_tasks() -> list[str]:
    """Return the shipped tasks, with the families from easy to hard."""

    def rank(name: str) -> int:
        family = name.partition("/")[0]
        known = family in FIRST_FAMILIES
        return FIRST_FAMILIES.index(family) if known else len(FIRST_FAMILIES)

    return sorted(task_names(), key=lambda name: (rank(name), name))


def best_of(best: Mapping[str, int], name: str, *, most: bool = False) -> int | None:
    """Return the player's fewest steps for a task with any number of players, or most points."""
    found = [result for task, result in best.items() if task.partition("@")[0] == name]
    return max(found, default=None) if most else min(found, default=None)


def players_words(task: Task) -> str:
    """Return the number of players, such as `2 to 4 players`."""
    counts = task.problem.seats or (task.seats,)
    low, high = min(counts), max(counts)
    if low == high:
        return "1 player" if low == 1 else f"{low} players"
    return f"{low} to {high} players"


def _dish(name: str) -> str:
    number = name.rpartition("/")[2].partition("_")[0]
    dish = dish_title(name, _task(name).goal_description)
    return f"{number} {dish}" if number.isdigit() else dish


# Each drawing of the list asks for the same tasks several times.
@lru_cache(maxsize=128)
def _task(name: str) -> Task:
    return load_task(name)


Ask = Callable[[Form], Awaitable[object]]
"""Function that shows a form until it has a result."""

TWO_PEOPLE = (
    "You walk with WASD and use E. The second person walks with the arrow keys and uses the right "
    "Shift key, or has a gamepad."
)
PARTNERS = (
    ("partners: human pace", "partner"),
    ("learners: slow and unsure", "learner"),
    ("experts: never rest", "expert"),
    ("random: do anything", "random"),
)


def pace_words(rate: float) -> str:
    """Return a pace in words, such as `5 steps a second (normal)`."""
    kind = "easy" if rate < 4 else "normal" if rate <= 6 else "hard"
    return f"{rate_words(rate)} ({kind})"


class TaskChoice:
    """Rows for the task, its goal and the number of players.

    Args:
        words: Function that describes a number of players.
        changed: Function called after a change of the task or the players.
        you: Function that returns the player to mark in the picture.
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

    def describe(self) -> None:
        """Describe the numbers of players again, which mean something else now."""
        self._offer(self.seats)

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows for a form, without the players if there is only one choice."""
        several = len(self._seats.options) > 1
        return (self._task, self._goal, *([self._seats] if several else []))

    @property
    def task(self) -> str:
        return str(self._task.value)

    @property
    def seats(self) -> int:
        """The chosen number of players."""
        return int(str(self._seats.value))

    def picture(self, room: tuple[int, int]) -> Surface | None:
        """Return the picture of the kitchen once it is drawn."""
        # With one player, no mark is needed, and the list's picture of the task can be shared.
        if self._you is None or self.seats == 1:
            return self._pictures.at(self.task, room)
        load = partial(load_task, self.task, seats=self.seats)
        return self._pictures.at(f"{self.task} for {self.seats}", room, load, self._you)

    def load(self) -> bool:
        """Draw the kitchen; return whether it was not drawn before."""
        return self._pictures.load()

    async def pick(self, ask: Ask) -> None:
        """Let the player choose a task from the list."""
        picked = await ask(TaskPicker(self._settings, self.task).form)
        if picked != "back":
            self._task.choose(picked)
            self._follow()

    def remember(self) -> None:
        """Save the choice for the next time."""
        self._settings.task, self._settings.seats = self.task, self.seats

    def _follow(self) -> None:
        self._offer(self.seats)
        self._changed()

    def _offer(self, wanted: int) -> None:
        """Update the goal and the numbers of players to the task."""
        task = load_task(self.task)
        self._goal.label = task.goal_description
        counts = task.problem.seats or (task.seats,)
        self._seats.options = tuple((self._words(count), count) for count in counts)
        self._seats.choose(wanted)


class PlayMenu:
    """Menu for a local game."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._partner = Choice("Bots", PARTNERS, settings.partner)
        people = [("one: you", 1), ("two at this keyboard", 2)]
        self._people = Choice("People", people, 1, lambda _: self._describe())
        self._rate = Slider("Pace", settings.rate, 1, 12, 1, pace_words)
        self._ends = (Button("Start", "start"), Button("Back", "back"))
        self._task = TaskChoice(settings, self._team_words, self._arrange, seat_out_of_the_way)
        self.form = self._made()

    @property
    def setup(self) -> GameSetup:
        """The chosen game."""
        return GameSetup(
            task=self._task.task,
            seats=self._task.seats,
            partner=str(self._partner.value),
            rate=self._rate.value,
            people=self._companions + 1,
        )

    @property
    def _companions(self) -> int:
        """Number of people besides the first one."""
        return min(int(str(self._people.value)), self._task.seats) - 1

    async def ask(self, ask: Ask) -> GameSetup | None:
        """Show the menu until the player starts a game, and remember it; None to go back."""
        while (answer := await ask(self.form)) == "task":
            await self._task.pick(ask)
            # A form with a result is finished, so the menu continues in a new one.
            self.form = self._made()
        if answer != "start":
            return None
        self._task.remember()
        self._settings.partner, self._settings.rate = str(self._partner.value), self._rate.value
        return self.setup

    def _made(self) -> Form:
        layout = FormLayout(self._task.picture, pinned=1)
        return Form("Play here", self._rows(), layout=layout, idle=self._task.load)

    def _arrange(self) -> None:
        self.form.set_rows(self._rows())

    def _rows(self) -> tuple[Row, ...]:
        start, back = self._ends
        people = (self._people,) if self._task.seats > 1 else ()
        partners = (self._partner,) if self._task.seats > self._companions + 1 else ()
        return (start, *self._task.rows, *people, *partners, self._rate, back)

    def _describe(self) -> None:
        self._task.describe()
        self._arrange()
        self.form.message = TWO_PEOPLE if self._companions else ""

    def _team_words(self, seats: int) -> str:
        people = min(int(str(self._people.value)), seats)
        who, bots = "just you" if seats == 1 else "you", seats - people
        if people == 2:
            who = "you two"
        return who + {0: "", 1: " and a bot"}.get(bots, f" and {bots} bots")
