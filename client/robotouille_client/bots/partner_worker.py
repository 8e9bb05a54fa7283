"""The process in which the bots of a local game think.

It reads requests from its standard input and writes replies to its standard output, each a
MessagePack array. It ends at once where its input does: with the window, however that ended.

| request | reply |
| --- | --- |
| `["begin", task as JSON, kind, seed, players, words as JSON]` | none |
| `["meet", kinds, clock]`, `["hear", player, text]`, `["observe", moves]` | `say` |
| `["ask", player, facts, timers, busy]` | `say`; `["act", player, [name, …arguments], false]` |

Who does nothing answers with nil in the place of an action, and whether they wait.
`["say", player, text]` comes whenever a bot says something, and no other request waits; a move is
`[player, name, arguments, applied]`.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from threading import Thread
from typing import Any

import msgpack

from robotouille.domain.rendering import Language
from robotouille.domain.task import Task
from robotouille.world.world import World
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.partners import PromptPartners, prompt_partners

__all__ = ["main", "replies"]

NICENESS = 5
"""How far the window goes before bots."""
CHUNK = 65536


def replies(
    requests: Iterator[Any], is_last: Callable[[], bool] = lambda: True
) -> Iterator[tuple[Any, ...]]:
    """What the bots say and decide; `begin` comes first.

    Args:
        is_last: Whether no other request has come since. What bots say waits for that: it is of
            the state in which it is read, not of one before a long thought.
    """
    _, task, kind, seed, players, words = next(requests)
    world = World(Task.from_json(json.loads(task)))
    language = Language.model_validate_json(words)
    partners = prompt_partners(world.initial, BotKind(kind), seed, players, language)
    for what, *about in requests:
        _tell(partners, world, what, *about)
        if is_last():
            yield from (("say", player, text) for player, text in partners.spoken())
        for player, action, waiting in partners.answers():
            did = None if action is None else (action.name, *action.arguments)
            yield "act", player, did, waiting


def _tell(partners: PromptPartners, world: World, what: str, *about: Any) -> None:
    if what == "meet":
        partners.meet(*about)
    elif what == "hear":
        partners.hear(*about)
    elif what == "observe":
        (moves,) = about
        world.admit(name for _, _, arguments, _ in moves for name in arguments)
        partners.observe(
            [(player, world.action(name, *args), applied) for player, name, args, applied in moves]
        )
    else:
        player, facts, timers, busy = about
        partners.ask(player, world.restore(int.from_bytes(facts, "big"), timers, busy))


def _read(source: int, requests: SimpleQueue[Any]) -> None:
    """Take in requests while the bots think; without a window there is nothing to think about."""
    unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=0)
    while data := os.read(source, CHUNK):
        unpacker.feed(data)
        for request in unpacker:
            requests.put(request)
    os._exit(0)


def main() -> None:
    """Think until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C is for the window, which ends this.
    with contextlib.suppress(AttributeError, OSError):
        os.nice(NICENESS)
    output = os.dup(1)
    os.dup2(2, 1)  # Whatever is printed by mistake is no reply.
    requests: SimpleQueue[Any] = SimpleQueue()
    Thread(target=_read, args=(0, requests), daemon=True).start()
    with contextlib.suppress(BrokenPipeError), os.fdopen(output, "wb", buffering=0) as out:
        for reply in replies(iter(requests.get, None), requests.empty):
            out.write(msgpack.packb(reply))


if __name__ == "__main__":
    main()
