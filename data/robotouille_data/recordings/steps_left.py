"""How far from the goal an episode ended: the fewest steps left, as far as they are found out."""

from __future__ import annotations

from collections import deque

from robotouille.errors import RobotouilleError
from robotouille.planning.search_result import Limits
from robotouille.planning.steps_to_go import StepsToGo
from robotouille.replay.container import plain
from robotouille.replay.recording import Recording

__all__ = ["REACHED", "UNKNOWN", "StepsLeft", "steps_left"]

ALONE, FIRST, KNOWN = Limits(expansions=2000), Limits(expansions=50), Limits(expansions=0)
"""Of one player's search; of a team's first plan; and where that plan is carried out alone."""

StepsLeft = tuple[int | None, int | None, bool | None]
"""At least so many steps, at most so many (None: no plan is known), and whether the goal is out of
reach; nothing of it where nobody asked."""
REACHED: StepsLeft = (0, 0, False)
UNKNOWN: StepsLeft = (None, None, None)


def steps_left(content: bytes) -> StepsLeft:
    """Of a recording, by re-simulation and a search that expansions limit, and nothing else: the
    same recording gives the same numbers everywhere. Nothing is known where it does not
    re-simulate.
    """
    try:
        recording = Recording(plain(content)[0])
        world = recording.world
        ((_, state),) = deque(recording.states(), maxlen=1)
        distance = StepsToGo(world)
        if len(world.players) > 1:
            distance(world.initial, FIRST)
        left = distance(state, ALONE if len(world.players) == 1 else KNOWN)
    except (RobotouilleError, LookupError, ValueError):
        return UNKNOWN
    return (None, None, True) if left.dead else (left.bound, left.steps, False)
