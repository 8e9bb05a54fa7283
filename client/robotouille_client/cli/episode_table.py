"""Episodes as rows of CSV: what to open, what was opened, what there is."""

from __future__ import annotations

import csv
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import IO, Any

from pydantic import ValidationError

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille.replay.recorder import iso_time

__all__ = ["TableError", "closed_codes", "listed_row", "read_requests", "seconds", "write_table"]

MAX_ROWS = 10_000
UNITS = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86_400}
NUMBERS = {
    "seats": int, "max_steps": int, "seed": int, "step_rate": float, "move_budget": float,
    "grace": float,
}  # fmt: skip
WORDS = ("task", "clock", "timing", "thinking", "absence", "stand_in", "chat")
COLUMNS = (*WORDS, *NUMBERS, "open_for", "phrases")
GROUPS = ("label", "shown_as", "delay_ms", "participant")
"""Columns `GROUP.NAME`: a label's name, or a player's."""


class TableError(RobotouilleError):
    """A table that says not what to open, and where."""


def seconds(text: str) -> float:
    """A duration: seconds, or with a unit as `90m`, `12h`, `30d`; TableError for anything else."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([smhd]?)", text.strip())
    if found is None:
        raise TableError(f"{text!r} is no duration; write it as 90, 15m, 12h or 30d")
    return float(found[1]) * UNITS[found[2]]


def read_requests(
    path: Path, **defaults: Any
) -> tuple[list[dict[str, str]], list[messages.Create]]:
    """The rows of a table, and what each asks for; `defaults` are fields that a row leaves out.

    Raises:
        TableError: The file cannot be read; a column is missing or unknown; a value cannot be.
    """
    rows = _read(path)
    if not rows:
        raise TableError(f"{path}: has no row under its heading")
    requests = []
    for number, row in enumerate(rows, 2):
        try:
            requests.append(messages.Create(**{**defaults, **_fields(row)}))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field = ".".join(str(part) for part in first["loc"])
            raise TableError(f"{path}: line {number}: {field}: {first['msg']}") from None
        except (TableError, ValueError) as error:
            raise TableError(f"{path}: line {number}: {error}") from None
    return rows, requests


def closed_codes(path: Path) -> list[str]:
    """The column `code` of a table; TableError if it has none."""
    rows = _read(path, columns=None)
    if not rows or "code" not in rows[0]:
        raise TableError(f"{path}: there is no column 'code'")
    return [row["code"] for row in rows if row["code"]]


def _read(path: Path, columns: Sequence[str] | None = COLUMNS) -> list[dict[str, str]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, strict=True)
            if columns is not None:
                _check_columns(path, reader.fieldnames or [])
            return list(_rows(path, reader))
    except OSError as error:
        raise TableError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise TableError(f"{path}: is not UTF-8 text") from None
    except csv.Error as error:
        raise TableError(f"{path}: is no CSV: {error}") from None


def _check_columns(path: Path, names: Sequence[str]) -> None:
    if "task" not in names:
        semicolons = "; write commas, not semicolons" if any(";" in name for name in names) else ""
        raise TableError(f"{path}: there is no column 'task'{semicolons}")
    for name in names:
        group, dot, of = name.partition(".")
        if name not in COLUMNS and not (dot and of and group in GROUPS):
            known = ", ".join((*COLUMNS, *(f"{group}.NAME" for group in GROUPS)))
            raise TableError(f"{path}: the column {name!r} is not known; there are {known}")
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise TableError(f"{path}: there are two columns {twice!r}")


def _rows(path: Path, reader: csv.DictReader[str]) -> Iterator[dict[str, str]]:
    for number, row in enumerate(reader, 1):
        if number > MAX_ROWS:
            raise TableError(f"{path}: has more than {MAX_ROWS:,} rows")
        if None in row or None in row.values():
            found = "more" if None in row else "fewer"
            raise TableError(f"{path}: line {reader.line_num}: {found} values than columns")
        yield {name: value.strip() for name, value in row.items()}


def _fields(row: Mapping[str, str]) -> dict[str, Any]:
    """What a row says, as fields of `create`; an empty cell says nothing."""
    fields: dict[str, Any] = {}
    treatments: dict[str, dict[str, Any]] = {}
    for name, value in row.items():
        group, _, of = name.partition(".")
        if not value:
            continue
        if group == "label":
            fields.setdefault("labels", {})[of] = value
        elif group == "participant":
            fields.setdefault("participants", {})[of] = value
        elif group == "shown_as":
            treatments.setdefault(of, {})["shown_as"] = value
        elif group == "delay_ms":
            treatments.setdefault(of, {})["delay_ms"] = _number(int, name, value)
        elif name == "open_for":
            fields[name] = seconds(value)
        elif name == "phrases":
            fields[name] = [phrase.strip() for phrase in value.split("|")]
        else:
            fields[name] = _number(NUMBERS[name], name, value) if name in NUMBERS else value
    return {**fields, **({"treatments": treatments} if treatments else {})}


def _number(kind: type[int] | type[float], name: str, value: str) -> float:
    try:
        return kind(value)
    except ValueError:
        raise TableError(f"{name}: {value!r} is no number") from None


def listed_row(info: messages.EpisodeInfo, now: datetime) -> dict[str, Any]:
    """An episode of a list, which was asked for `now`, as a row; it closes at a time in UTC."""
    closes = ""
    if info.closes is not None:
        closes = (now + timedelta(seconds=info.closes)).strftime("%Y-%m-%dT%H:%M:%SZ")
    seats = (f"{seat.player}: {seat.name}" for seat in info.seats if seat.name)
    return {
        "code": info.code,
        "episode": info.episode,
        "task": info.task,
        "clock": str(info.clock),
        "phase": str(info.phase),
        "step": info.step,
        "max_steps": info.max_steps,
        "seats": "; ".join(seats),
        "spectators": info.spectators,
        "created": iso_time(info.created),
        "closes": closes,
        "reason": info.reason,
        "detail": info.detail,
        **{f"label.{name}": value for name, value in info.labels.items()},
    }


def write_table(rows: Iterable[Mapping[str, Any]], path: Path | None, *, secret: bool) -> None:
    """Write rows as CSV, to a file or to the standard output; nobody else may read `secret` ones.

    Raises:
        TableError: It cannot be written.
    """
    rows = list(rows)
    columns = list(dict.fromkeys(name for row in rows for name in row))
    try:
        with _opened(path, secret=secret) as file:
            writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        raise TableError(f"{path}: cannot be written: {error.strerror or error}") from None


@contextmanager
def _opened(path: Path | None, *, secret: bool) -> Iterator[IO[str]]:
    if path is None:
        yield sys.stdout
        return
    mode = 0o600 if secret else 0o666
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
    with os.fdopen(number, "w", encoding="utf-8", newline="") as file:
        if secret:
            path.chmod(mode)
        yield file
