"""The decision process of a task: states, actions, steps and what they look like in words."""

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.state import Progress, State
from robotouille.world.world import Attempt, Step, World, shared_world

__all__ = ["Attempt", "GroundAction", "Progress", "State", "Step", "World", "shared_world"]
