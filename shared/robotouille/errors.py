"""Errors that the project raises.

    RobotouilleError
    ├── FileError            a file is unreadable or invalid; has all faults found in it
    ├── UnknownTaskError     there is no task of this name
    ├── InapplicableError    a caller applied an action whose preconditions do not hold
    ├── UnknownNameError     a world has no such action, object or player; also a KeyError
    ├── WrongWorldError      a state or an action belongs to another task; also a ValueError
    ├── WrongArgumentError   an argument of the Python API is invalid; also a TypeError
    ├── SlotOverflowError    an episode created more objects than arrays have slots for
    ├── RecordingError       a recording is damaged, or its replay gives other states
    ├── IllegalEventError    an episode or a seat cannot handle an event in its current state
    ├── MissingExtraError    an optional library is missing; the message has the install command
    ├── PluginError          an installed plug-in cannot be loaded; the message names it
    └── ProtocolError        a message from a peer cannot be accepted; `code` is stable

`FileError` and `ProtocolError` report mistakes in a file or in a peer's message.
`InapplicableError`, the four errors after it and `IllegalEventError` report mistakes of the caller.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from typing import ParamSpec

P = ParamSpec("P")

MAX_FAULTS = 1_000
"""Most faults that one check reports."""
MAX_COMPARED = 50_000
"""Most names that one check compares for its suggestions: a second or two."""
MAX_COMPARISONS = 50_000_000
"""Most pairs of characters that are compared for one suggestion: a second or two."""
MISSPELT, SIMILAR = 0.85, 0.6
"""Least similarity of a misspelt name and of a suggested one, from 0 to 1."""
MIN_BEGINNING = 3
"""Shortest text that is taken as the beginning of a name."""
MAX_BEGINNINGS = 3
"""Most names that are suggested because they begin with the text."""
_left_to_compare: ContextVar[int | None] = ContextVar("left_to_compare", default=None)


def with_article(noun: str) -> str:
    """Return a noun with `a` or `an`."""
    return f"{'an' if noun[:1].lower() in tuple('aeiou') else 'a'} {noun}"


def did_you_mean(name: object, valid: Iterable[str], most: int = 1) -> str:
    """Return the clause `; did you mean 'x'?`, or an empty string if no valid name is similar.

    Names with a letter or two more or less come first, then names that begin with the unknown one,
    then other similar names.

    Args:
        name: The unknown name; its case is ignored.
        valid: The known names.
        most: Largest number of similar names.
    """
    return suggestion(most_similar(name, valid, most))


def suggestion(names: Sequence[str]) -> str:
    """Return the clause `; did you mean 'x' or 'y'?`, or an empty string without names."""
    if not names:
        return ""
    *others, last = map(repr, names)
    return f"; did you mean {', '.join(others)} or {last}?" if others else f"; did you mean {last}?"


def most_similar(name: object, valid: Iterable[str], most: int = 1) -> list[str]:
    """Return the names that `did_you_mean` suggests."""
    names = {known.casefold(): str(known) for known in valid}
    # Names in files from strangers can be long, and comparing two takes the product of their
    # lengths.
    if len(str(name)) * sum(map(len, names)) > MAX_COMPARISONS:
        return []
    left = _left_to_compare.get()
    if left is not None:
        if len(names) > left:
            return []
        _left_to_compare.set(left - len(names))
    wanted = str(name).casefold()
    similar = difflib.get_close_matches(wanted, list(names), n=most, cutoff=SIMILAR)
    misspelt = [each for each in similar if _likeness(each, wanted) >= MISSPELT]
    return [names[each] for each in misspelt or _beginning_with(wanted, names) or similar]


def _likeness(known: str, wanted: str) -> float:
    # In this order, as `get_close_matches` compares: the ratio is not symmetric.
    return difflib.SequenceMatcher(None, known, wanted).ratio()


def _beginning_with(text: str, names: Iterable[str]) -> list[str]:
    """Return the shortest names that begin with a text, if it is long enough to be meant so."""
    if len(text) < MIN_BEGINNING:
        return []
    found = (name for name in names if name.startswith(text))
    return sorted(found, key=lambda name: (len(name), name))[:MAX_BEGINNINGS]


SEVERITIES = ("error", "warning", "note")


@dataclass(frozen=True, slots=True, order=True)
class Fault:
    """One fault of a file and its place in the file.

    `severity` is `error` (the file cannot be used), `warning` (probably a mistake) or `note` (a
    suggestion).
    """

    path: str
    message: str
    severity: str = "error"

    def __str__(self) -> str:
        where = f"{self.path}: " if self.path else ""
        return f"{where}{self.message}"


def bounded(check: Callable[P, list[Fault]]) -> Callable[P, list[Fault]]:
    """Limit the suggestions and the faults of a check.

    Without limits, a file of a few megabytes of unknown names takes minutes.
    """

    @wraps(check)
    def limited(*args: P.args, **kwargs: P.kwargs) -> list[Fault]:
        token = _left_to_compare.set(MAX_COMPARED)
        try:
            faults = check(*args, **kwargs)
        finally:
            _left_to_compare.reset(token)
        more = faults[MAX_FAULTS:]
        if not more:
            return faults
        worst = min((fault.severity for fault in more), key=SEVERITIES.index)
        return [*faults[:MAX_FAULTS], Fault("", f"and {len(more):,} more faults", worst)]

    return limited


class RobotouilleError(Exception):
    """Base of all errors of this project."""


MAX_SHOWN = 100
"""Faults of a file that an error's message lists."""


class FileError(RobotouilleError):
    """A file cannot be used; `faults` has all reasons, so that one correction suffices."""

    def __init__(self, file: str, faults: Iterable[Fault]) -> None:
        self.file = file
        self.faults = tuple(faults)
        shown = file.replace("\n", "\N{REPLACEMENT CHARACTER}")  # Each fault is one line.
        lines = [f"{shown}: {fault}" for fault in self.faults[:MAX_SHOWN]]
        if len(self.faults) > MAX_SHOWN:
            lines.append(f"{shown}: and {len(self.faults) - MAX_SHOWN:,} more faults")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[type[FileError], tuple[str, tuple[Fault, ...]]]:
        return FileError, (self.file, self.faults)


class UnknownTaskError(RobotouilleError):
    """Neither a shipped task nor a file has this name; `file` is a similar file, if any."""

    def __init__(self, name: str, valid: Iterable[str], file: str | None = None) -> None:
        self.name = name
        names = list(valid)
        # Tasks may be named by folder and number, 01 or 1. A misspelt folder is then nearer to such
        # a short name than to the right full one.
        short = {short[0] for each in names if (short := re.match(r".*/[^_]*", each))}
        short |= {each.replace("/0", "/") for each in short}
        near = (
            did_you_mean(name, [*names, *sorted(short)])
            if file is None
            else f"; did you mean {file!r}?"
        )
        hint = f"{near} `robotouille tasks`" if near else "; `robotouille tasks`"
        super().__init__(f"no task or file {name!r}{hint} lists the tasks")


class InapplicableError(RobotouilleError):
    """An action was applied in a state in which its preconditions do not hold."""

    def __init__(self, action: str, unmet: Sequence[object]) -> None:
        self.action = action
        self.unmet = unmet
        super().__init__(f"{action}: {'; '.join(map(str, unmet))}")


class UnknownNameError(RobotouilleError, KeyError):
    """A world has no such name; the message suggests the most similar one."""

    # `KeyError.__str__` would quote the message.
    __str__ = Exception.__str__

    @classmethod
    def player(cls, name: object, players: Sequence[str]) -> UnknownNameError:
        """Return the error for a player that does not exist."""
        near = did_you_mean(name, players) or f"; players: {', '.join(players)}"
        return cls(f"no player {name!r}{near}")


class WrongWorldError(RobotouilleError, ValueError):
    """A state, an action or facts do not belong to this world."""


class WrongArgumentError(RobotouilleError, TypeError):
    """An argument is invalid; the message states what is expected."""


class SlotOverflowError(RobotouilleError):
    """More created objects of a kind exist at once than arrays have slots for."""

    def __init__(self, kind: str, found: int, slots: int) -> None:
        self.kind, self.found, self.slots = kind, found, slots
        super().__init__(
            f"the state has {found} objects of kind {kind!r} but there are {slots} slots; "
            f"use World(task, slots={{{kind!r}: {found}}})"
        )

    def __reduce__(self) -> tuple[type[SlotOverflowError], tuple[str, int, int]]:
        return SlotOverflowError, (self.kind, self.found, self.slots)


class IllegalEventError(RobotouilleError):
    """A life cycle has no transition for an event in its current state; nothing has changed."""

    def __init__(self, whose: str, state: str, event: str) -> None:
        self.state = state
        self.event = event
        super().__init__(f"{whose} in state {state} cannot handle {event}")


class TooHardError(RobotouilleError):
    """A kitchen that cannot be played any further."""


class GoalTooHardError(TooHardError):
    """A goal with too many choices of objects to check in a step."""


class TooManyObjectsError(TooHardError, ValueError):
    """More created objects than the facts about them have room for."""


class RecordingError(RobotouilleError):
    """A recording is damaged, or its replay gives other states."""


class MissingExtraError(RobotouilleError):
    """An optional library is missing."""

    def __init__(self, what: str, extra: str) -> None:
        self.extra = extra
        super().__init__(f"{what} needs an optional library: pip install 'robotouille[{extra}]'")


class PluginError(RobotouilleError):
    """A plug-in of another distribution cannot be loaded."""

    def __init__(self, group: str, name: str, target: str, why: str) -> None:
        self.group, self.name, self.target, self.why = group, name, target, why
        super().__init__(f"the plug-in {name!r} ({target}) of {group} cannot be loaded: {why}")

    def __reduce__(self) -> tuple[type[PluginError], tuple[str, str, str, str]]:
        return PluginError, (self.group, self.name, self.target, self.why)


class ProtocolError(RobotouilleError):
    """A message cannot be accepted; the connection stays open."""

    def __init__(self, code: str, message: str, field: str = "", ref: int | None = None) -> None:
        self.ref = ref
        self.code = code
        self.message = message
        self.field = field
        super().__init__(f"{code}: {message}" + (f" ({field})" if field else ""))
