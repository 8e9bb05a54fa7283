"""What vectors, masks and numbers of actions mean in one task, for the codebook."""

from __future__ import annotations

from typing import Any

from robotouille.world.world import World
from robotouille_data.exports.formats.recorded import Moment

__all__ = ["NOTHING", "action_number", "layout_notes"]

NOTHING = -1
"""The number of a seat's action in a step in which nothing of it was applied."""


def layout_notes(world: World) -> dict[str, Any]:
    """The task, and a name for each number of a vector and for each action of each player."""
    encoding = world.encoding
    return {
        "task": world.task.name,
        "digest": world.task.digest,
        "layout_version": encoding.version,
        "columns": list(encoding.columns),
        "actions": {
            player: [action.sentence for action in world.ground_actions(player)]
            for player in world.players
        },
    }


def action_number(moment: Moment, player: str) -> int:
    """The number of what was applied of a player's in a step."""
    move = moment.moves.get(player)
    return NOTHING if move is None else moment.before.action_number(move.action, player)
