"""Two actions of a player that lead to and fro, so that it can act for ever."""

from __future__ import annotations

from functools import cache

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["NamedMove", "to_and_fro"]

NamedMove = dict[str, str | list[str]]
"""An action as the protocol names it."""


@cache
def to_and_fro(task: str, player: str) -> tuple[NamedMove, NamedMove]:
    """An action that is valid when the task begins, and the one that undoes it.

    Raises RobotouilleError where the task has no such pair.
    """
    start = World(task).initial
    for there in start.actions(player):
        back = _undoing(start, there, player)
        if back is not None:
            return _named(there), _named(back)
    message = f"{player} of {task} cannot go to and fro; take another --task"
    raise RobotouilleError(message)


def _undoing(start: State, there: GroundAction, player: str) -> GroundAction | None:
    away = start.step(there)
    if away.goal_reached or away.state == start:
        return None
    for back in away.state.actions(player):
        home = away.state.step(back)
        if home.state == start and not home.goal_reached:
            return back
    return None


def _named(action: GroundAction) -> NamedMove:
    return {"name": action.name, "args": list(action.arguments)}
