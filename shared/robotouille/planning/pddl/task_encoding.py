"""A task as a PDDL domain and problem, in one of two encodings."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from robotouille.planning.pddl.durative_encoding import encode_durative
from robotouille.planning.pddl.expressiveness import check
from robotouille.planning.pddl.lifting.lifted import Lifted, roomy
from robotouille.planning.pddl.pddl_names import PddlNames
from robotouille.planning.pddl.step_encoding import encode_steps
from robotouille.world.world import World

__all__ = ["Encoding", "EncodingStyle", "encode"]


class EncodingStyle(StrEnum):
    """How time is said: as steps, exactly, or by durative actions, without pauses."""

    STEPS = "steps"
    DURATIVE = "durative"


@dataclass(frozen=True)
class Encoding:
    """The two files, and what is needed to read a plan for them."""

    domain: str
    problem: str
    lifted: Lifted
    names: PddlNames


def encode(
    world: World, style: EncodingStyle = EncodingStyle.STEPS, *, created: int | None = None
) -> Encoding:
    """Write a task in PDDL, with room for so many created objects of each kind.

    Raises PddlError where that encoding cannot say it.
    """
    lifted = Lifted(roomy(world, created))
    check(lifted)
    names = PddlNames(lifted.world)
    write = encode_steps if style is EncodingStyle.STEPS else encode_durative
    domain, problem = write(lifted)
    return Encoding(domain.text(names), problem.text(names), lifted, names)
