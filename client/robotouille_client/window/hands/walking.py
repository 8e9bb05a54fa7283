"""Which station a direction key leads to.

Players go from station to station. Of the walks that are valid now a direction means the one to
the nearest station on that side; what lies off to the side of the way counts as farther away.
"""

from __future__ import annotations

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.floor import Tile
from robotouille.world.scene import Placed
from robotouille.world.world import State

__all__ = ["towards", "walks"]

_ASIDE = 2
"""By how much more a tile to the side counts than one ahead."""


def walks(state: State, me: str) -> dict[str, GroundAction]:
    """The valid walks of a player by the station they lead to."""
    found: dict[str, GroundAction] = {}
    for action in state.actions(me):
        there = action.destination
        if there is not None:
            found.setdefault(there, action)
    return found


def towards(
    state: State, me: str, direction: tuple[int, int], placed: dict[str, Placed]
) -> GroundAction | None:
    """The walk that a direction means; None where there is no free station on that side.

    Sides are seen from the station where the player is, else from the player's own tile.
    """
    own = placed.get(me)
    if own is None:
        return None
    here = placed[own.at].tile if own.at else own.tile
    if here is None:
        return None
    nearest: tuple[int, str] | None = None
    valid = walks(state, me)
    for name in valid:
        there = placed[name].tile
        far = None if there is None else _distance(here, there, direction)
        if far is not None and (nearest is None or (far, name) < nearest):
            nearest = (far, name)
    return valid[nearest[1]] if nearest else None


def _distance(here: Tile, there: Tile, direction: tuple[int, int]) -> int | None:
    """How far a tile is in a direction; None if it is not on that side."""
    dx, dy = there[0] - here[0], there[1] - here[1]
    ahead = dx * direction[0] + dy * direction[1]
    aside = abs(dx * direction[1]) + abs(dy * direction[0])
    return ahead + _ASIDE * aside if ahead > 0 else None
