"""States as few bytes, for those who have a world of the same task already.

A packed state is MessagePack: `VERSION`, the first bytes of the task's digest, the facts, the
timers' rows, and who is busy. It has its own bytes and none of the task's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import msgpack

from robotouille.domain.task import Task
from robotouille.errors import WrongArgumentError, WrongWorldError
from robotouille.world.timers import BusyRow, TimerRow

__all__ = ["PackedState", "packed", "unpacked"]

VERSION = 1

DIGEST_BYTES = 8
MAX_NAME = 1_000
"""Characters of a name in a packed state; those of tasks are much shorter."""


class PackedState(NamedTuple):
    """What `World.restore` takes."""

    facts: int
    rows: tuple[TimerRow, ...]
    busy: tuple[BusyRow, ...]


def packed(task: Task, state: PackedState) -> bytes:
    """A state of a task as bytes."""
    facts = state.facts.to_bytes((state.facts.bit_length() + 7) // 8, "little")
    found: bytes = msgpack.packb((VERSION, _mark(task), facts, state.rows, state.busy))
    return found


def unpacked(task: Task, data: bytes) -> PackedState:
    """What `packed` made bytes of; `World.restore` looks at the rest.

    Raises:
        WrongArgumentError: These are no packed state, or another version's.
        WrongWorldError: It is one of another task.
    """
    try:
        version, mark, facts, rows, busy = msgpack.unpackb(data, use_list=False)
    except Exception as error:  # msgpack has many kinds
        raise WrongArgumentError(f"expected a packed state: {error}") from None
    if version != VERSION or not isinstance(facts, bytes):
        raise WrongArgumentError(f"expected a packed state of version {VERSION}, found {version!r}")
    if mark != _mark(task):
        raise WrongWorldError(f"the packed state is of another task than {task.name}")
    if not (_are(rows, _is_timer) and _are(busy, _is_busy)):
        raise WrongArgumentError("expected a packed state: its timers are none")
    return PackedState(int.from_bytes(facts, "little"), rows, busy)


def _is_timer(row: tuple[Any, ...]) -> bool:
    action, index, arguments, counters = row
    return (
        _is_name(action)
        and isinstance(index, int)
        and _are(arguments, _is_name)
        and _are(counters, lambda counter: isinstance(counter, int))
    )


def _is_busy(row: tuple[Any, ...]) -> bool:
    player, steps = row
    return _is_name(player) and isinstance(steps, int)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= MAX_NAME


def _are(values: Any, kind: Callable[[Any], bool]) -> bool:
    """Whether these are a list of one kind."""
    try:
        return isinstance(values, tuple) and all(map(kind, values))
    except (TypeError, ValueError):  # a row that is none, or has another length
        return False


def _mark(task: Task) -> Any:
    return bytes.fromhex(task.digest)[:DIGEST_BYTES]
