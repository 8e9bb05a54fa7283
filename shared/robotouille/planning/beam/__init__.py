"""Beam search on joint steps, guided by the work that is left: plans at once, in any domain."""

from robotouille.planning.beam.planner import BeamPlanner, Solution

__all__ = [
    "BeamPlanner",
    "Solution",
]
