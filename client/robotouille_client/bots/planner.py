"""The planner bot: a planner that tells whoever started it when it has no plan."""

from __future__ import annotations

from robotouille.planning.policies.planner_policy import PlannerPolicy
from robotouille.program import tell
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["TellingPlanner"]


class TellingPlanner(PlannerPolicy):
    """Says on stderr when it finds no plan, and when it has one again."""

    def act(self, state: State) -> GroundAction | None:
        had_plan = self.has_plan
        action = super().act(state)
        if self.has_plan != had_plan:
            found = "has a plan again" if self.has_plan else "finds no plan from here"
            tell(f"{self.player} {found}", err=True)
        return action
