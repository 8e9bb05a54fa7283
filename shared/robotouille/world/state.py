"""Another way to `robotouille.world.world.State`."""

from robotouille.world.timers import Progress
from robotouille.world.world import State

__all__ = ["Progress", "State"]
