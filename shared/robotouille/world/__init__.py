"""The decision process of a task: states, actions, steps, and their descriptions in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.world.grounding.actions import GroundAction
    from robotouille.world.timers import Progress
    from robotouille.world.unmet import Attempt
    from robotouille.world.world import State, Step, World, shared_world
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.world.grounding.actions",
        "robotouille.world.timers",
        "robotouille.world.unmet",
        "robotouille.world.world",
    )

__all__ = ["Attempt", "GroundAction", "Progress", "State", "Step", "World", "shared_world"]
