"""Export of tasks to PDDL for other planners, and import of their plans (docs/planners.md)."""

from robotouille.planning.pddl.foreign_plans import read_pddl_plan
from robotouille.planning.pddl.task_encoding import EncodingStyle, PddlEncoding, PddlError, encode

__all__ = ["EncodingStyle", "PddlEncoding", "PddlError", "encode", "read_pddl_plan"]
