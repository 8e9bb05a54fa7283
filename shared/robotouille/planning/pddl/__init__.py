"""Tasks in PDDL for other planners, and their plans back (docs/pddl.md)."""

from robotouille.planning.pddl.expressiveness import PddlError
from robotouille.planning.pddl.foreign_plans import read_pddl_plan
from robotouille.planning.pddl.task_encoding import Encoding, EncodingStyle, encode

__all__ = ["Encoding", "EncodingStyle", "PddlError", "encode", "read_pddl_plan"]
