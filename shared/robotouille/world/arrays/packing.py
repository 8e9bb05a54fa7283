"""States as few bytes, for those who have a world of the same task already.

A packed state is MessagePack: `VERSION`, the first bytes of the task's digest, the facts, the
timers' rows, and who is busy. It has its own bytes and none of the task's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import msgpack

from robotouille.domain.task import Task
from robotouille.errors import WrongArgumentError, WrongWorldError

__all__ = ["PackedState", "packed", "unpacked"]

VERSION = 1

DIGEST_BYTES = 8


class PackedState(NamedTuple):
    """What `World.restore` takes."""

    facts: int
    rows: tuple[tuple[str, int, tuple[str, ...], tuple[int, ...]], ...]
    busy: tuple[tuple[str, int], ...]


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
    return PackedState(int.from_bytes(facts, "little"), rows, busy)


def _mark(task: Task) -> Any:
    return bytes.fromhex(task.digest)[:DIGEST_BYTES]
