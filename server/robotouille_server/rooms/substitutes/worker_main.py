"""The process in which substitute bots decide.

It reads requests from its standard input and writes replies to its standard output, each a
MessagePack array, and does one after the other. It ends where its input does: with the server,
however that ended.

| request | reply |
| --- | --- |
| `["task", digest, json]` | none |
| `["learn", number, digest, player]` | `[number, "done", nil]` |
| `["ask", number, digest, …question]` | `[number, "done", [action, …arguments]]`, or nil |

A request about a task that is not known (any more) is replied to by `[number, "unknown", nil]`, one
that failed by `[number, "failed", traceback]`.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import traceback
from collections.abc import Iterator
from typing import Any

import msgpack

from robotouille.domain.task import Task
from robotouille_server.rooms.substitutes.bots import Bots, Question

__all__ = [
    "DONE",
    "FAILED",
    "MAX_BYTES",
    "UNKNOWN",
    "ask_request",
    "learn_request",
    "main",
    "task_request",
]  # fmt: skip

DONE, UNKNOWN, FAILED = "done", "unknown", "failed"
MAX_BYTES = 16 * 1024 * 1024
"""Of one request or reply."""
NICENESS = 5
"""How far games, the server's and everybody else's, go before bots."""
CHUNK = 65536


def task_request(task: Task) -> bytes:
    """Show a task, so that requests about it can be answered."""
    return _packed("task", task.digest, json.dumps(task.json))


def learn_request(number: int, digest: str, player: str) -> bytes:
    return _packed("learn", number, digest, player)


def ask_request(number: int, digest: str, question: Question) -> bytes:
    q, facts = question, question.facts
    whole = facts.to_bytes((facts.bit_length() + 7) // 8, "big")
    about = (q.bot, q.player, q.kind, whole, q.timers, q.busy, q.observed)
    return _packed("ask", number, digest, *about)


def _packed(*values: Any) -> bytes:
    packed: bytes = msgpack.packb(values)
    return packed


def _question(
    bot: int, player: str, kind: Any, facts: bytes, timers: Any, busy: Any, observed: Any
) -> Question:
    return Question(bot, player, kind, int.from_bytes(facts, "big"), timers, busy, observed)


def _reply(bots: Bots, request: Any) -> bytes | None:
    what, *rest = request
    if what == "task":
        bots.show(Task.from_json(json.loads(rest[1])))
        return None
    number, digest, *about = rest
    if not bots.knows(digest):
        return _packed(number, UNKNOWN, None)
    try:
        if what == "learn":
            bots.learn(digest, *about)
            return _packed(number, DONE, None)
        return _packed(number, DONE, bots.answer(digest, _question(*about)))
    except Exception:
        return _packed(number, FAILED, traceback.format_exc())


def _requests(source: int) -> Iterator[Any]:
    unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=MAX_BYTES)
    while data := os.read(source, CHUNK):
        unpacker.feed(data)
        yield from unpacker


def main() -> None:
    """Answer until the input ends."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # They are the server's, which ends this process.
    with contextlib.suppress(AttributeError, OSError):
        os.nice(NICENESS)
    replies = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # Whatever is printed by mistake is no reply.
    bots = Bots()
    try:
        for request in _requests(0):
            reply = _reply(bots, request)
            if reply is not None:
                replies.write(reply)
    except BrokenPipeError:
        sys.exit(0)  # The server is gone.


if __name__ == "__main__":
    main()
