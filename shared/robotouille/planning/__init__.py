"""Planning: satisficing plans for one player or a team, and policies that play by them.

Pure and deterministic: nothing here reads a clock, a file or a global source of randomness.
"""

from robotouille.planning.beam.planner import BeamPlanner, Solution
from robotouille.planning.plan import Plan, read_plan, write_plan
from robotouille.planning.validation import PlanReport, Rejection, replay

__all__ = [
    "BeamPlanner",
    "Plan",
    "PlanReport",
    "Rejection",
    "Solution",
    "read_plan",
    "replay",
    "write_plan",
]
