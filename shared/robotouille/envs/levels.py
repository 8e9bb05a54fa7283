"""Kitchens of different sizes for one task: the levels of a curriculum (docs/train.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from robotouille.domain.task import Task
from robotouille.errors import WrongArgumentError
from robotouille.generation import GenerationError, Generator, Kind, Parameters


@dataclass(frozen=True)
class Level:
    """A kitchen for a task, with more cells, irrelevant stations or irrelevant items.

    Args:
        cells: Width and height of the kitchen in tiles; by default the task's, enlarged if
            necessary.
        stations: Number of irrelevant stations to add; by default one for each irrelevant item.
        items: Number of irrelevant items to add.
        seats: Number of players, at most the task's, which is the default.
        kitchen: Seed of the kitchen. Different seeds place and choose stations and items
            differently.
    """

    cells: tuple[int, int] | None = None
    stations: int | None = None
    items: int = 0
    seats: int | None = None
    kitchen: int = 0

    def task_for(self, task: Task) -> Task:
        """Return a task in this kitchen. A plan for the task works there too, with other names.

        Raises:
            WrongArgumentError: The objects do not fit, the task has no such number of seats, or the
                task is a shift.
        """
        seats = self.seats or task.seats
        if seats not in (task.problem.seats or (task.seats,)) or seats > task.seats:
            raise WrongArgumentError(f"levels: {task.name} has no {seats} seats here")
        seated = replace(task, seats=seats)
        stations = self.items if self.stations is None else self.stations
        if self.cells is None and not stations and not self.items:
            return seated
        width, height = self.cells or (None, None)
        try:
            parameters = Parameters(width=width, height=height, stations=stations, items=self.items)
            drawn = Generator(task, Kind.NOISY, parameters).instance(self.kitchen).task
        except GenerationError as error:
            raise WrongArgumentError(f"levels: {error}") from None
        return replace(drawn, seats=seats, timing=task.timing)
