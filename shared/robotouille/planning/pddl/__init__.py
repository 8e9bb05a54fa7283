"""Tasks in PDDL for other planners, and their plans back (docs/pddl.md)."""

from robotouille.planning.pddl.encoding import Encoding, Style, encode
from robotouille.planning.pddl.limits import PddlError
from robotouille.planning.pddl.plans import read_pddl_plan

__all__ = ["Encoding", "PddlError", "Style", "encode", "read_pddl_plan"]
