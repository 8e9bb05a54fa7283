"""Every error the project raises on purpose.

    RobotouilleError
    ├── FileError            a file is unreadable or wrong; carries every fault found in it
    ├── UnknownTaskError     no task goes by that name
    ├── InapplicableError    a caller applied an action whose preconditions do not hold
    ├── RecordingError       a recording is damaged or does not re-simulate
    ├── MissingExtraError    an optional library is needed; the message has the install line
    └── ProtocolError        a peer's message cannot be honoured; `code` is stable on the wire

`FileError` and `ProtocolError` are somebody else's fault (a file's author, a peer);
`InapplicableError` is the caller's.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

__all__ = [
    "Fault",
    "FileError",
    "InapplicableError",
    "MissingExtraError",
    "ProtocolError",
    "RecordingError",
    "RobotouilleError",
    "UnknownTaskError",
    "did_you_mean",
]


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """The clause `; did you mean 'x'?`, or nothing where no valid name is near."""
    near = difflib.get_close_matches(name, list(valid), n=1, cutoff=0.6)
    return f"; did you mean {near[0]!r}?" if near else ""


@dataclass(frozen=True, slots=True, order=True)
class Fault:
    """One thing wrong with a file: where inside it, and what.

    `severity` is `error` (cannot be used so), `warning` (surely not meant) or `note` (works, and
    may be better).
    """

    path: str
    message: str
    severity: str = "error"

    def __str__(self) -> str:
        where = f"{self.path}: " if self.path else ""
        return f"{where}{self.message}"


class RobotouilleError(Exception):
    """Root of the tree above."""


MAX_SHOWN = 100
"""Faults of a file that are put into words."""


class FileError(RobotouilleError):
    """A file that cannot be used, with all its faults at once."""

    def __init__(self, file: str, faults: Iterable[Fault]) -> None:
        self.file = file
        self.faults = tuple(faults)
        lines = [f"{file}: {fault}" for fault in self.faults[:MAX_SHOWN]]
        if len(self.faults) > MAX_SHOWN:
            lines.append(f"{file}: and {len(self.faults) - MAX_SHOWN:,} more faults")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[type[FileError], tuple[str, tuple[Fault, ...]]]:
        return FileError, (self.file, self.faults)


class UnknownTaskError(RobotouilleError):
    """No task of that name in the catalogue, and no such file."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        self.name = name
        super().__init__(
            f"no task or file {name!r}{did_you_mean(name, valid)}; "
            "`robotouille tasks` lists the tasks"
        )


class InapplicableError(RobotouilleError):
    """An action was applied in a state in which its preconditions do not hold."""

    def __init__(self, action: str, unmet: tuple[str, ...]) -> None:
        self.action = action
        self.unmet = unmet
        super().__init__(f"{action}: {'; '.join(unmet)}")


class RecordingError(RobotouilleError):
    """A recording that is damaged, or that does not re-simulate."""


class MissingExtraError(RobotouilleError):
    """An optional library is missing."""

    def __init__(self, what: str, extra: str) -> None:
        self.extra = extra
        super().__init__(f"{what} needs an optional library: pip install 'robotouille[{extra}]'")


class ProtocolError(RobotouilleError):
    """A message that cannot be honoured; the connection lives on."""

    def __init__(self, code: str, message: str, field: str = "", ref: int | None = None) -> None:
        self.ref = ref
        self.code = code
        self.message = message
        self.field = field
        super().__init__(f"{code}: {message}" + (f" ({field})" if field else ""))
