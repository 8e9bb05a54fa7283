"""Parameters of the generator, its errors, and its random choices."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import TypeVar

from robotouille.errors import RobotouilleError

T = TypeVar("T")


# Only `random()` is used: Python guarantees its sequence across versions, unlike `shuffle` or
# `choice`.
class SeededRng:
    """Deterministic stream of choices from a seed."""

    def __init__(self, seed: str) -> None:
        self._random = random.Random(seed).random

    def below(self, limit: int) -> int:
        """Return a number from 0 to `limit` - 1."""
        return int(self._random() * limit)

    def between(self, low: int, high: int) -> int:
        """Return a number from `low` to `high` inclusive."""
        return low + self.below(high - low + 1)

    def happens(self, probability: float) -> bool:
        """Return True with a probability."""
        return self._random() < probability

    def one_of(self, values: Sequence[T]) -> T:
        """Return one of the values, each with equal probability."""
        return values[self.below(len(values))]

    def shuffled(self, values: Sequence[T]) -> list[T]:
        """Return the values in a random order (Fisher and Yates)."""
        result = list(values)
        for last in range(len(result) - 1, 0, -1):
            other = self.below(last + 1)
            result[last], result[other] = result[other], result[last]
        return result


USUAL = (2, 4)
"""Default range of the number of added objects."""

MAX_OBJECTS = 1000
MAX_SIDE = 100


class Kind(StrEnum):
    """Kind of instance; see docs/planners.md.

    `FREE`: objects are anywhere and may be in each other's way. `NOISY`: the layout changes and
    irrelevant objects are added, but a renamed plan for the original still works.
    """

    FREE = "free"
    NOISY = "noisy"


class GenerationError(RobotouilleError):
    """There is no such instance; `parameter` names the option to change."""

    def __init__(self, parameter: str, message: str) -> None:
        self.parameter = parameter
        self.message = message
        super().__init__(f"{parameter}: {message}")

    def __reduce__(self) -> tuple[type[GenerationError], tuple[str, str]]:
        return type(self), (self.parameter, self.message)


class AttemptError(GenerationError):
    """One attempt failed; another one of the same seed may succeed."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """Requirements for an instance. None leaves the choice to the generator.

    `width` and `height` default to the original's, enlarged if necessary. `stations` and `items`
    are the numbers of irrelevant objects to add. With `stacking`, items may be on each other (in a
    noisy instance only irrelevant ones on irrelevant stations); the default is true for free
    instances. With `held`, players may hold objects at the start. `min_steps` and `max_steps` limit
    the optimal number of steps for the default number of players. Sizes are in tiles.

    Raises:
        GenerationError: A number is out of range; `parameter` is its name.
    """

    width: int | None = None
    height: int | None = None
    stations: int | None = None
    items: int | None = None
    stacking: bool | None = None
    held: bool = False
    min_steps: int | None = None
    max_steps: int | None = None

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            self._check(name, 1, MAX_SIDE)
        for name in ("stations", "items"):
            self._check(name, 0, MAX_OBJECTS)
        for name in ("min_steps", "max_steps"):
            self._check(name, 1, None)
        if self.min_steps and self.max_steps and self.min_steps > self.max_steps:
            message = f"{self.min_steps} is more than max_steps, {self.max_steps}"
            raise GenerationError("min_steps", message)

    def _check(self, name: str, low: int, high: int | None) -> None:
        value = getattr(self, name)
        if value is not None and (value < low or (high is not None and value > high)):
            valid = f"at least {low}" if high is None else f"{low} to {high}"
            raise GenerationError(name, f"expected {valid}, found {value}")

    @property
    def banded(self) -> bool:
        """True if the optimal number of steps is limited."""
        return self.min_steps is not None or self.max_steps is not None

    def stacks(self, kind: Kind) -> bool:
        """Return whether items may be on each other."""
        return kind is Kind.FREE if self.stacking is None else self.stacking

    def asked(self) -> dict[str, bool | int]:
        """Return the parameters that differ from the defaults."""
        chosen = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v for k, v in chosen.items() if v != getattr(DEFAULT, k)}


DEFAULT = Parameters()


@dataclass(frozen=True, slots=True)
class Amounts:
    """Numbers of irrelevant stations and items in one instance."""

    stations: int
    items: int

    @staticmethod
    def of(parameters: Parameters, kind: Kind, rng: SeededRng) -> Amounts:
        """Return the requested numbers, and random ones for the others."""
        stations, items = rng.between(*USUAL), rng.between(*USUAL)
        if parameters.stations is not None:
            stations = parameters.stations
        if parameters.items is not None:
            items = parameters.items
        # In a noisy instance every irrelevant item needs an irrelevant station.
        if kind is Kind.NOISY and parameters.items is None:
            items = min(items, stations)
        elif kind is Kind.NOISY and parameters.stations is None:
            stations = max(stations, items)
        return Amounts(stations, items)
