"""Beam search on joint steps, guided by the remaining work: quick plans in any domain."""

from robotouille.planning.beam.planner import BeamPlanner, Solution

__all__ = ["BeamPlanner", "Solution"]
