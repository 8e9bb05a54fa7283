"""Every error the project raises on purpose.

    RobotouilleError
    ├── FileError            a file is unreadable or wrong; carries every fault found in it
    ├── UnknownTaskError     no task goes by that name
    ├── InapplicableError    a caller applied an action whose preconditions do not hold
    ├── UnknownNameError     a world has no such action, object or player; also a KeyError
    ├── WrongWorldError      a state or an action belongs to another task; also a ValueError
    ├── WrongArgumentError   an argument of the Python API is of no use; also a TypeError
    ├── SlotOverflowError    play has created more objects than arrays have slots for
    ├── RecordingError       a recording is damaged or does not re-simulate
    ├── IllegalEventError    an episode or a seat was told of what cannot happen to it now
    ├── MissingExtraError    an optional library is needed; the message has the install line
    ├── PluginError          an installed plug-in cannot be loaded; the message names it
    └── ProtocolError        a peer's message cannot be honoured; `code` is stable on the wire

`FileError` and `ProtocolError` are somebody else's fault (a file's author, a peer);
`InapplicableError`, the four after it and `IllegalEventError` are the caller's.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

__all__ = [
    "Fault",
    "FileError",
    "IllegalEventError",
    "InapplicableError",
    "MissingExtraError",
    "PluginError",
    "ProtocolError",
    "RecordingError",
    "RobotouilleError",
    "SlotOverflowError",
    "UnknownNameError",
    "UnknownTaskError",
    "WrongArgumentError",
    "WrongWorldError",
    "did_you_mean",
]


def did_you_mean(name: object, valid: Iterable[str], most: int = 1) -> str:
    """The clause `; did you mean 'x'?`, or nothing where no valid name is near.

    Args:
        name: What was said; its case does not matter.
        valid: What could have been meant.
        most: How many of the nearest are given.
    """
    names = {known.casefold(): known for known in valid}
    near = difflib.get_close_matches(str(name).casefold(), list(names), n=most, cutoff=0.6)
    if not near:
        return ""
    *others, last = [repr(names[each]) for each in near]
    return f"; did you mean {', '.join(others)} or {last}?" if others else f"; did you mean {last}?"


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
    """No shipped task has that name, and no such file is there; `file` is one that may be meant."""

    def __init__(self, name: str, valid: Iterable[str], file: str | None = None) -> None:
        self.name = name
        near = did_you_mean(name, valid) if file is None else f"; did you mean {file!r}?"
        super().__init__(f"no task or file {name!r}{near}; `robotouille tasks` lists the tasks")


class InapplicableError(RobotouilleError):
    """An action was applied in a state in which its preconditions do not hold."""

    def __init__(self, action: str, unmet: Sequence[object]) -> None:
        self.action = action
        self.unmet = unmet
        super().__init__(f"{action}: {'; '.join(map(str, unmet))}")


class UnknownNameError(RobotouilleError, KeyError):
    """A name that a world does not know; the message gives the nearest one that it does."""

    __str__ = Exception.__str__


class WrongWorldError(RobotouilleError, ValueError):
    """A state, an action or facts that do not belong to this world."""


class WrongArgumentError(RobotouilleError, TypeError):
    """An argument that is none of what a method takes; the message says what it takes."""


class SlotOverflowError(RobotouilleError):
    """More created objects of a kind exist at once than arrays have slots for."""

    def __init__(self, kind: str, found: int, slots: int) -> None:
        self.kind, self.found, self.slots = kind, found, slots
        super().__init__(
            f"there are {found} of {kind!r}, and slots for {slots}; "
            f"ask for more: World(task, slots={{{kind!r}: {found}}})"
        )

    def __reduce__(self) -> tuple[type[SlotOverflowError], tuple[str, int, int]]:
        return SlotOverflowError, (self.kind, self.found, self.slots)


class IllegalEventError(RobotouilleError):
    """Something was to happen that a life cycle has no transition for; nothing has changed."""

    def __init__(self, whose: str, state: str, event: str) -> None:
        self.state = state
        self.event = event
        super().__init__(f"{whose} that is {state} has no transition for {event}")


class RecordingError(RobotouilleError):
    """A recording that is damaged, or that does not re-simulate."""


class MissingExtraError(RobotouilleError):
    """An optional library is missing."""

    def __init__(self, what: str, extra: str) -> None:
        self.extra = extra
        super().__init__(f"{what} needs an optional library: pip install 'robotouille[{extra}]'")


class PluginError(RobotouilleError):
    """A plug-in of another distribution that cannot be loaded."""

    def __init__(self, group: str, name: str, target: str, why: str) -> None:
        self.group, self.name, self.target, self.why = group, name, target, why
        super().__init__(f"the plug-in {name!r} ({target}) of {group} cannot be loaded: {why}")

    def __reduce__(self) -> tuple[type[PluginError], tuple[str, str, str, str]]:
        return PluginError, (self.group, self.name, self.target, self.why)


class ProtocolError(RobotouilleError):
    """A message that cannot be honoured; the connection lives on."""

    def __init__(self, code: str, message: str, field: str = "", ref: int | None = None) -> None:
        self.ref = ref
        self.code = code
        self.message = message
        self.field = field
        super().__init__(f"{code}: {message}" + (f" ({field})" if field else ""))
