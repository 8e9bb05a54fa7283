"""Requests to substitute bots."""

from __future__ import annotations

from typing import Any

from robotouille.planning.bot_process import state_row
from robotouille.world.world import State
from robotouille_server.rooms.substitutes.bots import Question

__all__ = ["question"]


def question(state: State, bot: int = 1, player: str = "robot1", **more: Any) -> Question:
    """Return a request for `player`'s action in a state, to a planner by default."""
    more.setdefault("kind", "planner")
    return Question(bot, player, state=state_row(state), **more)
