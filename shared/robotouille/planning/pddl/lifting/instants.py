"""Creations and deletions: what is due is carried out by actions without cost, before all else.

The run of a step marks them as due and ends the quiet; each is carried out by an action of its
own, and `go-on` restores the quiet when none is left. So an object's name is that of the next
token, however many are created at once.
"""

from __future__ import annotations

from collections.abc import Iterator

from robotouille.domain.schema import Creation
from robotouille.planning.pddl.lifting.lifted import THERE, Lifted, follows, fresh
from robotouille.planning.pddl.lifting.timer_facts import QUIET, TimerFacts, TimerPart, literals
from robotouille.planning.pddl.syntax import Literal, PddlAction, PddlEffect, Variable

__all__ = ["instant_actions", "instant_name"]


def instant_name(timer: TimerFacts, part: TimerPart) -> str:
    """`create-fill-pot-0-2`."""
    return f"~{part.definition.type}:{timer.name}:{part.slot}"


def instant_actions(lifted: Lifted) -> Iterator[PddlAction]:
    """An action for each creation and deletion, and `go-on`; nothing where there are none."""
    for timer, part in lifted.instants:
        if isinstance(part.definition, Creation):
            yield _create(lifted, timer, part, part.definition)
        else:
            yield _delete(lifted, timer, part)
    if lifted.instants:
        noisy = [(term, False) for term in lifted.dues]
        yield PddlAction("~go-on", (), ((QUIET, False), *noisy), (PddlEffect(((QUIET, True),)),))


def _create(lifted: Lifted, timer: TimerFacts, part: TimerPart, definition: Creation) -> PddlAction:
    made = definition.created_obj
    new, after = f"?{made.param}", "?~after"
    parameters = (*timer.variables, (new, f"={made.type}"))
    condition: tuple[Literal, ...] = ((timer.due(part), True), ((fresh(made.name), new), True))
    effects = [
        PddlEffect(
            (
                (timer.due(part), False),
                ((fresh(made.name), new), False),
                ((THERE, new), True),
                *literals(definition.fx),
            )
        ),
        PddlEffect(
            (((fresh(made.name), after), True),),
            (((follows(made.name), new, after), True),),
            ((after, f"={made.type}"),),
        ),
        *_begin(lifted, part, None),
    ]
    return PddlAction(instant_name(timer, part), parameters, condition, tuple(effects))


def _delete(lifted: Lifted, timer: TimerFacts, part: TimerPart) -> PddlAction:
    subject = part.subject
    kind = dict(timer.variables)[subject]
    kept = tuple(one for one in literals(part.definition.fx) if subject not in one[0])
    done = ((timer.due(part), False), ((THERE, subject), False))
    effects = [PddlEffect((*done, *kept)), *_forget(lifted, subject, kind)]
    effects += _begin(lifted, part, subject)
    condition = ((timer.due(part), True),)
    return PddlAction(instant_name(timer, part), timer.variables, condition, tuple(effects))


def _begin(lifted: Lifted, part: TimerPart, deleted: str | None) -> Iterator[PddlEffect]:
    """Start what is nested in a creation or deletion, unless it is about what was deleted."""
    for definition in part.definition.sfx:
        timer = lifted.born[id(definition)]
        if deleted not in dict(timer.variables):
            for literal in timer.start:
                yield PddlEffect((literal,), ((timer.active, False),))


def _forget(lifted: Lifted, subject: str, kind: str) -> Iterator[PddlEffect]:
    """Make every fact about an object false, and stop the effects about it."""
    own = {p: lifted.predicates[p] for p in lifted.world.table.fluents}
    timed = {f[0]: lifted.predicates[f[0]] for t in lifted.timers for f in t.flags}
    for timer in lifted.timers:
        counted = (timer.count(p, "")[0] for p in timer.parts if p.counts)
        timed |= {name: lifted.predicates[name] for name in counted}
    for predicate, types in {**own, **timed}.items():
        for position, type_ in enumerate(types):
            if type_ == kind:
                yield _clear(predicate, types, position, subject)


def _clear(predicate: str, types: tuple[str, ...], position: int, subject: str) -> PddlEffect:
    others: list[Variable] = [(f"?~x{i}", t) for i, t in enumerate(types) if i != position]
    arguments = [subject if i == position else f"?~x{i}" for i in range(len(types))]
    return PddlEffect((((predicate, *arguments), False),), (), tuple(others))
