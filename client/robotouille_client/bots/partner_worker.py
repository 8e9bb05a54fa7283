"""Process in which the bot partners of a local game plan.

| request | reply |
| --- | --- |
| `["begin", task as JSON, kind, seed, players, words as JSON]` | none |
| `["meet", kinds, clock]`, `["hear", player, text]`, `["observe", moves]` | `say` |
| `["ask", player, state]` | `say`; `["act", player, [name, …arguments], waits]` |

A bot that does nothing answers with nil in place of the action. `["say", player, text]` reports a
chat message of a bot. It is sent only while no other request waits.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

from robotouille.domain.rendering import Language
from robotouille.domain.task import Task
from robotouille.planning.bot_process import read_moves, read_state, serve_requests
from robotouille.world.world import World
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.partners import PromptPartners, prompt_partners


def replies(
    requests: Iterator[Any], is_last: Callable[[], bool] = lambda: True
) -> Iterator[tuple[Any, ...]]:
    """Yield what the bots say and decide. The first request must be `begin`.

    Args:
        requests: The requests of the window.
        is_last: Returns whether no other request waits. Chat messages are held back until then,
            so that they are about the state that the player sees.
    """
    _, task, kind, seed, players, words = next(requests)
    world = World(Task.from_json(json.loads(task)))
    language = Language.model_validate_json(words)
    partners = prompt_partners(world.initial, BotKind(kind), seed, players, language)
    for what, *about in requests:
        _apply(partners, world, what, *about)
        if is_last():
            yield from (("say", player, text) for player, text in partners.spoken())
        for player, action, waiting in partners.answers():
            did = None if action is None else (action.name, *action.arguments)
            yield "act", player, did, waiting


def _apply(partners: PromptPartners, world: World, what: str, *about: Any) -> None:
    if what == "meet":
        partners.meet(*about)
    elif what == "hear":
        partners.hear(*about)
    elif what == "observe":
        partners.observe(read_moves(world, *about))
    else:
        player, state = about
        partners.ask(player, read_state(world, state))


def main() -> None:
    """Run the process of the bot partners."""
    serve_requests(replies)


if __name__ == "__main__":
    main()
