"""Labels of failures by people, in a file, and how well they agree with the classifier."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille_evaluation.metrics.rows import Category, EpisodeRow

__all__ = ["Label", "agreement", "cohens_kappa", "paired", "read_labels"]


class Label(BaseModel):
    """What somebody says of one episode: its `recording` names it, as in the row, and `run` where
    several runs have played it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    recording: str
    category: Category
    subcategory: str = ""
    labeller: str = ""
    note: str = ""
    run: str = ""


_labels = TypeAdapter(tuple[Label, ...])


def read_labels(path: Path) -> tuple[Label, ...]:
    """The labels in a file: JSON (a list of objects), or CSV with a head line of the same names.

    Raises:
        FileError: The file cannot be read, or holds something else.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        rows = (
            list(csv.DictReader(text.splitlines())) if path.suffix == ".csv" else json.loads(text)
        )
        return _labels.validate_python(rows)
    except OSError as error:
        fault = Fault("", f"cannot be read: {error.strerror or error}")
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        fault = Fault(".".join(map(str, first["loc"])), first["msg"])
    except (ValueError, csv.Error) as error:
        fault = Fault("", f"is no list of labels: {error}")
    raise FileError(str(path), [fault])


def cohens_kappa(one: Sequence[str], other: Sequence[str]) -> float | None:
    """(p - e) / (1 - e): p the share of equal labels, e that expected by chance (Cohen, 1960).

    1 is full agreement, 0 what chance gives. None without labels, and where both give one and the
    same label to everything: then chance explains it all.

    Raises:
        ValueError: The two are not of the same length.
    """
    if len(one) != len(other):
        raise ValueError(f"{len(one)} labels are not paired with {len(other)}")
    number = len(one)
    if not number:
        return None
    equal = sum(a == b for a, b in zip(one, other, strict=True)) / number
    left, right = Counter(one), Counter(other)
    chance = sum(left[label] * right[label] for label in left) / number**2
    return None if chance == 1 else (equal - chance) / (1 - chance)


def paired(rows: Sequence[EpisodeRow], labels: Sequence[Label]) -> list[tuple[EpisodeRow, Label]]:
    """The rows of failed episodes with people's labels of the same recordings.

    Raises:
        RobotouilleError: A label names no run, and its recording is of several.
    """
    found: dict[str | None, list[EpisodeRow]] = {}
    for row in rows:
        found.setdefault(row.recording, []).append(row)
    pairs = []
    for label in labels:
        meant = [r for r in found.get(label.recording, ()) if label.run in ("", r.run)]
        if len(meant) > 1:
            runs = " and ".join(sorted({row.run for row in meant}))
            raise RobotouilleError(
                f"{label.recording} is of the runs {runs}: say which in a column `run`"
            )
        pairs += [(row, label) for row in meant if row.measures.failure]
    return pairs


def agreement(rows: Sequence[EpisodeRow], labels: Sequence[Label]) -> float | None:
    """Cohen's kappa between the classifier's categories in rows and people's labels of the same
    recordings; None if they have none in common."""
    pairs = [
        (row.measures.failure.category, label.category.value)
        for row, label in paired(rows, labels)
        if row.measures.failure
    ]
    return cohens_kappa([a for a, _ in pairs], [b for _, b in pairs])
