"""Choose a task: what it looks like, for how many it is, how long it takes, whether it was done."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from robotouille.certification.step_limit import retimed_length
from robotouille.domain.loading import load_task, task_names
from robotouille.domain.task import Task, Timing
from robotouille_client.window.forms.picker import Picker, PickerEntry, Told
from robotouille_client.window.forms.widgets import Button
from robotouille_client.window.shell.screens.thumbnails import Thumbnails
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.sources.task_titles import dish_title, family_title

__all__ = ["TaskPicker", "listed_tasks"]

FIRST_FAMILIES = ("training", "synchronous", "asynchronous", "multi_agent")
"""From easy to hard; others follow."""


class TaskPicker:
    """The form, whose result is a task's name, or `back`."""

    def __init__(self, settings: Settings, chosen: str) -> None:
        self._best = settings.best
        self._pictures = Thumbnails(settings.preferences.rendering)
        self._lengths: dict[str, int | None] = {}
        self._wanted: dict[str, None] = {}
        self.form = Picker(
            "Which task?",
            [self._entry(name) for name in listed_tasks()],
            [Button("Back", "back")],
            chosen=chosen,
            idle=self._load,
        )

    def _entry(self, name: str) -> PickerEntry:
        return PickerEntry(
            name,
            lambda: Told(_dish(name), self._detail(name)),
            group=family_title(name),
            picture=lambda room: self._pictures.at(name, room),
            about=lambda: self._about(name),
        )

    def _detail(self, name: str) -> str:
        """`for 2 to 4 · 35 steps · done in 40`."""
        words = [players_words(_task(name))]
        length = self._length(name)
        if length is not None:
            words.append(f"{length} steps")
        best = best_of(self._best, name)
        if best is not None:
            words.append(f"done in {best}")
        return " · ".join(words)

    def _about(self, name: str) -> str:
        """What is to be made, how long that takes, and how well it went."""
        words = [_task(name).goal_description]
        length, best = self._length(name), best_of(self._best, name)
        if length is not None:
            words.append(f"A very good game takes {length} steps.")
        words.append("Not done yet." if best is None else f"Your best game took {best} steps.")
        return "\n".join(words)

    def _length(self, name: str) -> int | None:
        """The steps of a very good game; None where they are not known, or not yet."""
        if name not in self._lengths:
            self._wanted.pop(name, None)
            self._wanted[name] = None
        return self._lengths.get(name)

    def _load(self) -> bool:
        """Find out how long a task takes, and draw a kitchen: those that were asked for last."""
        length = bool(self._wanted)
        if length:
            name, _ = self._wanted.popitem()
            self._lengths[name] = retimed_length(load_task(name, timing=Timing.PEOPLE))
        return self._pictures.load() or length


def listed_tasks() -> list[str]:
    """All shipped tasks, the families from easy to hard."""

    def rank(name: str) -> int:
        family = name.partition("/")[0]
        known = family in FIRST_FAMILIES
        return FIRST_FAMILIES.index(family) if known else len(FIRST_FAMILIES)

    return sorted(task_names(), key=lambda name: (rank(name), name))


def best_of(best: Mapping[str, int], name: str) -> int | None:
    """The fewest steps in which a task was done, with however many players."""
    found = [steps for task, steps in best.items() if task.partition("@")[0] == name]
    return min(found, default=None)


def players_words(task: Task) -> str:
    """`for 1`, `for 2 to 4`."""
    counts = task.problem.seats or (task.seats,)
    low, high = min(counts), max(counts)
    return f"for {low}" if low == high else f"for {low} to {high}"


def _dish(name: str) -> str:
    number = name.rpartition("/")[2].partition("_")[0]
    dish = dish_title(name, _task(name).goal_description)
    return f"{number} {dish}" if number.isdigit() else dish


@lru_cache(maxsize=128)
def _task(name: str) -> Task:
    return load_task(name)
