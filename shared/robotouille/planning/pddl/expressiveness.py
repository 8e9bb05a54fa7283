"""What PDDL cannot say, found before it is written."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from robotouille.domain.schema import Creation
from robotouille.errors import RobotouilleError
from robotouille.planning.pddl.lifting.lifted import Lifted
from robotouille.planning.pddl.lifting.symbolic_runs import runs
from robotouille.planning.pddl.lifting.timer_facts import TimerFacts, literals, tick
from robotouille.planning.pddl.syntax import Term

__all__ = ["PddlError", "check"]


class PddlError(RobotouilleError):
    """A task that an encoding cannot say."""


def check(lifted: Lifted) -> None:
    """Raise PddlError for timing profiles other than `benchmark`, for worlds without players, and
    where an effect reads at the end of a step what another changes there."""
    task = lifted.world.task
    if task.profile.steps_per_tile or task.profile.repeat_steps > 1:
        raise PddlError(f"PDDL is written for timing 'benchmark', found {task.timing.value!r}")
    if not lifted.world.players:
        raise PddlError(f"{task.name} has no players")
    for writer in lifted.timers:
        for reader in lifted.timers:
            for term in _tested(lifted, reader):
                if any(_clash(writer, reader, other, term) for other in _written(writer)):
                    raise PddlError(
                        f"an effect of {writer.action!r} changes {term[0]!r} at the end of a step "
                        f"and one of {reader.action!r} depends on it: the world updates them in "
                        "the order in which they began, which PDDL cannot say"
                    )


def _written(timer: TimerFacts) -> Iterator[Term]:
    """What a passive update can change, but for facts about an object that it creates."""
    for run in runs(partial(tick, timer=timer)):
        yield from run.writes
    for part in timer.parts:
        if part.instant:
            definition = part.definition
            new = f"?{definition.created_obj.param}" if isinstance(definition, Creation) else ""
            yield from (term for term, _ in literals(definition.fx) if new not in term)


def _tested(lifted: Lifted, timer: TimerFacts) -> Iterator[Term]:
    fluents = lifted.world.table.fluents
    for run in runs(partial(tick, timer=timer)):
        yield from (term for term, _ in run.tests if term[0] in fluents)


def _clash(writer: TimerFacts, reader: TimerFacts, written: Term, tested: Term) -> bool:
    """Whether two different effects may concern the same atom."""
    if written[0] != tested[0]:
        return False
    itself = {name for name, _ in writer.variables} <= set(written)
    return not (writer is reader and written == tested and itself)
