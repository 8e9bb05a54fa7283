"""Labels that people give to moments and spans of recordings, and the agreement of coders.

A step is the unit of both measures: for each label, a step has the value 1 if one of the coder's
moments or spans with this label covers it, and 0 otherwise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Field, ValidationError, model_validator

from robotouille.domain.json_files import read_json
from robotouille.domain.schema import Schema
from robotouille.errors import RobotouilleError
from robotouille.replay.container import MAX_FRAMES

MAX_LABELS = 40
MAX_ANNOTATIONS = 100_000
RESERVED_KEYS = " ,.+-"
"""Keys with a meaning of their own in a page."""


def _key(key: str) -> str:
    if key in RESERVED_KEYS or not key.isprintable():
        raise ValueError(f"the page uses the key {key!r}; choose a letter or a digit")
    return key.lower()


Id = Annotated[str, Field(min_length=1, max_length=60)]


class Label(Schema):
    """A label of a codebook, with the key that sets it."""

    id: Id
    title: Annotated[str, Field(min_length=1, max_length=200)]
    key: Annotated[str, Field(min_length=1, max_length=1), AfterValidator(_key)]


class Codebook(Schema):
    """Labels that coders choose from."""

    schema_uri: str | None = Field(default=None, alias="$schema")
    labels: Annotated[tuple[Label, ...], Field(min_length=1, max_length=MAX_LABELS)]

    @model_validator(mode="after")
    def _distinct(self) -> Codebook:
        for field in ("id", "key"):
            values = [getattr(label, field) for label in self.labels]
            twice = next((value for value in values if values.count(value) > 1), None)
            if twice is not None:
                raise ValueError(f"two labels have the {field} {twice!r}")
        return self


class Annotation(Schema):
    """A label on the steps from `first` to `last`; a moment is one step."""

    label: Id
    first: Annotated[int, Field(ge=0)]
    last: Annotated[int, Field(ge=0)]

    @model_validator(mode="after")
    def _ordered(self) -> Annotation:
        if self.last < self.first:
            raise ValueError(f"ends at step {self.last}, before its first step {self.first}")
        return self


class Annotations(Schema):
    """Annotations of one recording by one coder, as a page saves them.

    Attributes:
        recording: Digest of the recording.
        steps: Number of its steps. Step 0 is the state before the first one.
        labels: Ids of all labels of the codebook, used or not.
    """

    format: Annotated[int, Field(ge=1, le=1)]
    coder: Annotated[str, Field(max_length=80)]
    recording: Annotated[str, Field(max_length=80)]
    task: Annotated[str, Field(max_length=200)]
    steps: Annotated[int, Field(ge=0, le=MAX_FRAMES)]
    labels: Annotated[tuple[Id, ...], Field(min_length=1, max_length=MAX_LABELS)]
    annotations: Annotated[tuple[Annotation, ...], Field(max_length=MAX_ANNOTATIONS)]

    @model_validator(mode="after")
    def _fits(self) -> Annotations:
        for each in self.annotations:
            if each.label not in self.labels:
                raise ValueError(f"the label {each.label!r} is not in the codebook")
            if each.last > self.steps:
                raise ValueError(f"step {each.last} of a recording of {self.steps} steps")
        return self

    def changes(self, label: str) -> Iterator[int]:
        """Yield the steps at which the value of a label changes, in order. It begins with 0."""
        # Spans may overlap, so the changes at their ends are summed up once.
        changes: Counter[int] = Counter()
        for each in self.annotations:
            if each.label == label:
                changes[each.first] += 1
                changes[each.last + 1] -= 1
        covering = 0
        for step in sorted(changes):
            before, covering = covering, covering + changes[step]
            if (before > 0) != (covering > 0):
                yield step


def read_codebook(path: Path) -> Codebook:
    """Read a codebook: `{"labels": [{"id", "title", "key"}]}`.

    Raises:
        RobotouilleError: The file cannot be read, or is not a codebook.
    """
    return _read(path, Codebook)


def read_annotations(path: Path) -> Annotations:
    """Read the annotations that a page has saved.

    Raises:
        RobotouilleError: The file cannot be read, or has no annotations.
    """
    return _read(path, Annotations)


S = TypeVar("S", bound=Schema)


def _read(path: Path, kind: type[S]) -> S:
    value: Any = read_json(path)
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise RobotouilleError(f"{path}: {f'{place}: ' if place else ''}{first['msg']}") from None


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of coders about one label in all recordings.

    Attributes:
        coders: Number of coders.
        units: Number of steps that at least two coders have coded.
        used: Share of the values of these steps that are 1.
        kappa: Cohen's kappa; None unless there are two coders, or if the values never differ.
        alpha: Krippendorff's alpha for nominal data; None if the values never differ.
    """

    label: str
    coders: int
    units: int
    used: float
    kappa: float | None
    alpha: float | None


Units = Counter[tuple[int, ...]]
"""Combinations of the values of coders, with the number of steps that have them. The order of the
values counts only for two coders."""


def agreement(files: Sequence[Annotations]) -> Iterator[Agreement]:
    """Yield the agreement about each label, in the order of the codebook.

    Raises:
        RobotouilleError: The files do not fit together, or no recording has two coders.
    """
    recordings = _by_recording(files)
    coders = {each.coder for coded in recordings.values() for each in coded}
    for label in files[0].labels:
        units: Units = Counter()
        for coded in recordings.values():
            units.update(_units(coded, label))
        ones = sum(count * sum(unit) for unit, count in units.items())
        used = ones / sum(count * len(unit) for unit, count in units.items())
        two = len(coders) == 2
        yield Agreement(
            label, len(coders), units.total(), used, cohen(units) if two else None, alpha(units)
        )


def _units(coded: Sequence[Annotations], label: str) -> Units:
    """Return how often each combination of values occurs in the steps of a recording."""
    # Few bytes of a file can claim a million steps, so only the changes are visited.
    changes = [(step, coder) for coder, each in enumerate(coded) for step in each.changes(label)]
    values, units, first = [0] * len(coded), Units(), 0
    for step, coder in sorted(changes):
        units[_unit(values)] += step - first
        first = step
        values[coder] ^= 1
    units[_unit(values)] += coded[0].steps + 1 - first
    return +units


def _unit(values: Sequence[int]) -> tuple[int, ...]:
    # Forty coders have far more combinations of values than numbers of ones, which are all that
    # `alpha` needs.
    if len(values) == 2:
        return tuple(values)
    ones = sum(values)
    return (1,) * ones + (0,) * (len(values) - ones)


def _by_recording(files: Sequence[Annotations]) -> dict[str, list[Annotations]]:
    """Return the files of each recording with two coders or more, in the order of the coders."""
    found: dict[str, dict[str, Annotations]] = {}
    for each in files:
        coded = found.setdefault(each.recording, {})
        if each.coder in coded:
            raise RobotouilleError(f"two files of the coder {each.coder!r} for one recording")
        if each.labels != files[0].labels:
            raise RobotouilleError("the files have different codebooks")
        coded[each.coder] = each
    for coded in found.values():
        if len({each.steps for each in coded.values()}) > 1:
            raise RobotouilleError("files of one recording have different numbers of steps")
    both = {name: coded for name, coded in found.items() if len(coded) > 1}
    if not both:
        raise RobotouilleError("no recording was coded by two coders")
    return {name: [each for _, each in sorted(coded.items())] for name, coded in both.items()}


def cohen(units: Units) -> float | None:
    """Return Cohen's kappa of two coders, or None if it is undefined."""
    count = units.total()
    observed = sum(times for (a, b), times in units.items() if a == b) / count
    first, second = (sum(times * unit[k] for unit, times in units.items()) / count for k in (0, 1))
    expected = first * second + (1 - first) * (1 - second)
    return None if expected == 1 else (observed - expected) / (1 - expected)


def alpha(units: Units) -> float | None:
    """Return Krippendorff's alpha for the values 0 and 1, or None if all values are equal."""
    values = ones = 0
    observed = 0.0
    for unit, times in units.items():
        size, marked = len(unit), sum(unit)
        values, ones = values + times * size, ones + times * marked
        # Ordered pairs of different values, weighted as in the coincidence matrix.
        observed += times * 2 * marked * (size - marked) / (size - 1)
    zeros = values - ones
    if not ones or not zeros:
        return None
    return 1 - (values - 1) * observed / (2 * ones * zeros)


def rounded(value: float | None) -> str:
    """Return a measure with two digits, or `-` if it is undefined."""
    return "-" if value is None else f"{value:.2f}"


def rows(found: Iterable[Agreement]) -> Iterator[Mapping[str, str]]:
    """Yield the texts of a table."""
    for each in found:
        yield {
            "label": each.label,
            "coders": str(each.coders),
            "steps": str(each.units),
            "used": f"{each.used:.1%}",
            "kappa": rounded(each.kappa),
            "alpha": rounded(each.alpha),
        }
