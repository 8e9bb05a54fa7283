"""Process in which bots plan, so that planning does not delay games.

The process reads requests from its standard input and writes replies to its standard output. Both
are MessagePack arrays. What the requests mean is up to the caller: the server runs its substitutes
this way, and the window its bot partners.
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeAlias

import msgpack

if TYPE_CHECKING:
    from robotouille.planning.policies.policy import Did
    from robotouille.world.timers import BusyRow, TimerRow
    from robotouille.world.world import State, World

StateRow: TypeAlias = (
    "tuple[bytes, tuple[TimerRow, ...], tuple[BusyRow, ...], Sequence[Any] | None]"
)
MoveRow: TypeAlias = "tuple[str, str, tuple[str, ...], bool]"
"""Player, name and arguments of an action, and whether it was applied."""
Replies: TypeAlias = "Callable[[Iterator[Any], Callable[[], bool]], Iterable[tuple[Any, ...]]]"
"""Function that turns requests into replies. Its second argument tells whether the request that
was read last is the last one to have arrived."""

NICENESS = 5
"""Added to the niceness of the process, so that games and the window take precedence over bots."""
MAX_BYTES = 16 * 1024 * 1024
"""Maximum size of a request or reply."""
CHUNK = 65536


def packed(*values: Any) -> bytes:
    """Return a request or reply as bytes."""
    data: bytes = msgpack.packb(values)
    return data


def unpacker() -> msgpack.Unpacker:
    """Return a decoder for a stream of requests or replies."""
    return msgpack.Unpacker(use_list=False, max_buffer_size=MAX_BYTES)


def state_row(state: State) -> StateRow:
    """Return a state as plain values."""
    # MessagePack has no integers above 64 bits.
    facts = state.facts.to_bytes((state.facts.bit_length() + 7) // 8, "big")
    orders = None if state.orders is None else state.orders.row
    return facts, state.timer_rows(), state.timers.busy, orders


def read_state(world: World, row: StateRow) -> State:
    """Return the state of `state_row` in a world of the same task."""
    facts, timers, busy, orders = row
    return world.restore(int.from_bytes(facts, "big"), timers, busy, orders)


def read_moves(world: World, rows: Sequence[MoveRow]) -> Did:
    """Return the moves of a step in a world, which also learns the objects they created."""
    world.admit(argument for _, _, arguments, _ in rows for argument in arguments)
    return [(player, world.action(name, *args), applied) for player, name, args, applied in rows]


def serve_requests(replies: Replies) -> None:
    """Answer the requests on standard input until it ends.

    The process ends at once when its input does, even in the middle of a search: its owner has
    ended, for whatever reason.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # Ctrl+C is for the owner, which ends this process.
    with contextlib.suppress(AttributeError, OSError):
        os.nice(NICENESS)
    output = os.dup(1)
    os.dup2(2, 1)  # A stray print must not corrupt the replies.
    requests: SimpleQueue[Any] = SimpleQueue()
    Thread(target=_read, args=(0, requests), daemon=True).start()
    with contextlib.suppress(BrokenPipeError), os.fdopen(output, "wb", buffering=0) as out:
        for reply in replies(iter(requests.get, None), requests.empty):
            out.write(packed(*reply))


def _read(source: int, requests: SimpleQueue[Any]) -> None:
    """Queue requests while the bots plan."""
    stream = unpacker()
    while data := os.read(source, CHUNK):
        stream.feed(data)
        for request in stream:
            requests.put(request)
    os._exit(0)
