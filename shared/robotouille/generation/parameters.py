"""What one may ask of a generator, and how it says that it cannot be had."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

from robotouille.errors import RobotouilleError
from robotouille.generation.rng import SeededRng

__all__ = ["DEFAULT", "Amounts", "AttemptError", "GenerationError", "Kind", "Parameters"]

USUAL = (2, 4)
"""The smallest and the largest number of things that are added unless a number is asked for."""

MAX_OBJECTS = 1000
MAX_SIDE = 100


class Kind(StrEnum):
    """What becomes of the original; see docs/generation.md.

    `FREE`: everything anywhere, things in the way of one another. `NOISY`: the layout changes and
    irrelevant things are added, but a plan for the original still works, up to names.
    """

    FREE = "free"
    NOISY = "noisy"


class GenerationError(RobotouilleError):
    """There is no such instance; `parameter` names what would have to be asked for instead."""

    def __init__(self, parameter: str, message: str) -> None:
        self.parameter = parameter
        self.message = message
        super().__init__(f"{parameter}: {message}")

    def __reduce__(self) -> tuple[type[GenerationError], tuple[str, str]]:
        return type(self), (self.parameter, self.message)


class AttemptError(GenerationError):
    """One attempt came to nothing; another one of the same seed may."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """What an instance is to be like; None leaves it to the generator.

    `width` and `height` are the original's, or more where that is too narrow. `stations` and
    `items` are how many irrelevant ones are added. With `stacking`, items may lie on one another
    (in a noisy instance: irrelevant ones on irrelevant ones); free instances stack unless told
    otherwise. With `held`, players may hold something at the start. The optimal number of steps
    for the usual number of players is `min_steps` to `max_steps`. Sizes are in tiles.

    Raises:
        GenerationError: A number is out of its range; `parameter` is its name.
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
        """Whether the optimal number of steps matters."""
        return self.min_steps is not None or self.max_steps is not None

    def stacks(self, kind: Kind) -> bool:
        """Whether items may lie on one another."""
        return kind is Kind.FREE if self.stacking is None else self.stacking

    def asked(self) -> dict[str, bool | int]:
        """The parameters that are not left to the generator."""
        chosen = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v for k, v in chosen.items() if v != getattr(DEFAULT, k)}


DEFAULT = Parameters()


@dataclass(frozen=True, slots=True)
class Amounts:
    """How many irrelevant stations and items one instance gets."""

    stations: int
    items: int

    @staticmethod
    def of(parameters: Parameters, kind: Kind, rng: SeededRng) -> Amounts:
        """What was asked for; the rest is drawn, in a noisy instance a station for each item."""
        stations, items = rng.between(*USUAL), rng.between(*USUAL)
        if parameters.stations is not None:
            stations = parameters.stations
        if parameters.items is not None:
            items = parameters.items
        if kind is Kind.NOISY and parameters.items is None:
            items = min(items, stations)
        elif kind is Kind.NOISY and parameters.stations is None:
            stations = max(stations, items)
        return Amounts(stations, items)
