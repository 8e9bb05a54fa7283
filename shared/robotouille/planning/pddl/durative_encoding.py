"""The durative encoding: PDDL 2.1, an action of the world lasting 1, a delay as long as it takes.

An action does what it does at its start and frees its player at its end. A delay is an action of
its own that nobody performs: `delay-cook-0-1` may start once `cook` has, needs what the effect's
conditions say all the time, and does at its end what the delay brings about. It cannot pause.
"""

from __future__ import annotations

from collections.abc import Iterator

from robotouille.domain.schema import Conditional, Delayed, Repetitive
from robotouille.planning.pddl.expressiveness import PddlError
from robotouille.planning.pddl.lifting.goal_action import (
    DONE,
    candidate_facts,
    candidate_predicates,
    finish,
)
from robotouille.planning.pddl.lifting.instants import instant_actions
from robotouille.planning.pddl.lifting.lifted import SEAT, Lifted
from robotouille.planning.pddl.lifting.timer_facts import (
    NUMBER,
    QUIET,
    TimerFacts,
    TimerPart,
    literals,
)
from robotouille.planning.pddl.step_encoding import acting, numbers_of, successions
from robotouille.planning.pddl.syntax import (
    DurativeAction,
    Literal,
    PddlAction,
    PddlDomain,
    PddlEffect,
    PddlProblem,
    Term,
    Variable,
)
from robotouille.world.grounding.actions import ActionSchema

__all__ = ["encode_durative"]

REQUIREMENTS = (
    ":strips", ":typing", ":negative-preconditions", ":equality", ":conditional-effects",
    ":durative-actions", ":fluents",
)  # fmt: skip


def encode_durative(lifted: Lifted) -> tuple[PddlDomain, PddlProblem]:
    """The domain and problem of a world; raises PddlError where it cannot be said."""
    quiet: tuple[Literal, ...] = ((QUIET, True),) if lifted.instants else ()
    numbers = numbers_of(lifted)
    delays = [(timer, part) for timer in lifted.timers for part in _delays(timer)]
    domain = PddlDomain(
        requirements=REQUIREMENTS,
        types={SEAT: "object", **lifted.types, NUMBER: "object"},
        constants=(*numbers[:2], *lifted.constants),
        predicates={
            **{n: t for n, t in lifted.predicates.items() if n not in _unsaid(lifted)},
            **candidate_predicates(lifted),
            **{_running(timer)[0]: tuple(t for _, t in timer.variables) for timer, _ in delays},
            **({QUIET[0]: ()} if quiet else {}),
            "~free": (SEAT,),
            "~next": (NUMBER, NUMBER),
            DONE[0]: (),
        },
        functions={
            _lasts(timer, part, "")[0]: (dict(timer.variables)[part.subject],)
            for timer, part in delays
        },
        actions=(
            *(_act(lifted, schema, quiet) for schema in lifted.schemas),
            *(_delay(timer, part) for timer, part in delays),
            *(_follow(timer) for timer in lifted.timers if _follows(timer)),
            *instant_actions(lifted),
            finish(lifted, (), quiet),
        ),
        notes=_notes(lifted),
    )
    return domain, _problem(lifted, numbers, delays)


def _problem(
    lifted: Lifted, numbers: list[Variable], delays: list[tuple[TimerFacts, TimerPart]]
) -> PddlProblem:
    repeated = {
        timer.last(part, "", "")[0]
        for timer in lifted.timers
        for part in timer.parts
        if isinstance(part.definition, Repetitive)
    }
    facts: list[Term] = [("~free", player) for player in lifted.world.players]
    facts += [*lifted.facts(), *successions(numbers), *candidate_facts(lifted)]
    facts += [(*t, f"~n{count}") for t, count in lifted.last_counts() if t[0] in repeated]
    lasts = {timer.last(part, "", "")[0]: _lasts(timer, part, "")[0] for timer, part in delays}
    values: dict[Term, int] = {
        (lasts[t[0]], t[1]): n + 1 for t, n in lifted.last_counts() if t[0] in lasts
    }
    return PddlProblem(
        objects=(*lifted.objects, *numbers[2:]),
        facts=tuple(facts),
        goal=DONE,
        metric="total-time",
        values=values,
    )


def _notes(lifted: Lifted) -> tuple[str, ...]:
    task = lifted.world.task
    return (
        f"{task.name}@{task.seats}, with durative actions: delays do not pause. See docs/pddl.md.",
        *lifted.bounds(),
    )


def _act(lifted: Lifted, schema: ActionSchema, quiet: tuple[Literal, ...]) -> DurativeAction:
    parameters = lifted.parameters(schema)
    seat = parameters[0][0] if schema.player else "?~seat"
    others = () if schema.player else ((seat, SEAT),)
    effects = [_without_pauses(lifted, e) for e in acting(lifted, schema, ends_now=True)]
    return DurativeAction(
        name=schema.name,
        parameters=(*parameters, *others),
        duration=1,
        at_start=((("~free", seat), True), *quiet, *lifted.condition(schema)),
        over_all=(),
        start_effects=(
            PddlEffect(((("~free", seat), False),)),
            *(effect for effect in effects if effect.literals),
        ),
        end_effects=(PddlEffect(((("~free", seat), True),)),),
    )


def _without_pauses(lifted: Lifted, effect: PddlEffect) -> PddlEffect:
    """An effect without what only the end of a step looks at; empty if it depends on that."""
    unsaid = _unsaid(lifted)
    over = {t.over: t.active for t in lifted.timers if (t.over, True) in effect.literals}
    kept = [lit for lit in effect.literals if lit[0][0] not in unsaid]
    for active in over.values():
        if (active, True) in kept:
            kept.remove((active, True))
        else:
            kept.append((active, False))
    if any(term[0] in unsaid and value for term, value in effect.condition):
        kept = []
    condition = tuple(lit for lit in effect.condition if lit[0][0] not in unsaid)
    return PddlEffect(tuple(kept), condition, effect.variables)


def _unsaid(lifted: Lifted) -> set[str]:
    """The predicates that serve pauses and the ends of steps."""
    found = set()
    for timer in lifted.timers:
        found.add(timer.over[0])
        for part in timer.parts:
            found.add(timer.holding(part)[0])
            if isinstance(part.definition, Delayed):
                found |= {timer.count(part, "")[0], timer.last(part, "", "")[0]}
    return found


def _delays(timer: TimerFacts) -> Iterator[TimerPart]:
    """The delay of an effect, if it has one; PddlError for shapes that cannot be said."""
    part = timer.root
    if isinstance(part.definition, Conditional) and len(part.nested) == 1:
        part = part.nested[0]
    if isinstance(part.definition, Delayed) and not part.lasts:
        yield part
    elif part is not timer.root or part.lasts:
        raise PddlError(
            f"the durative encoding has delays within at most one condition; {timer.action!r} has "
            "an effect of another shape: use the step encoding"
        )


def _follows(timer: TimerFacts) -> bool:
    """Whether an effect waits for its conditions, and for nothing else."""
    return isinstance(timer.root.definition, Conditional) and not timer.root.nested


def _running(timer: TimerFacts) -> Term:
    return (f"~{timer.name}:running", *(name for name, _ in timer.variables))


def _lasts(timer: TimerFacts, part: TimerPart, subject: str) -> Term:
    return (f"~{timer.name}:lasts:{part.slot}", subject)


def _delay(timer: TimerFacts, part: TimerPart) -> DurativeAction:
    root = timer.root.definition
    due = [(timer.due(child), True) for child in part.nested]
    return DurativeAction(
        name=f"~delay:{timer.name}:{part.slot}",
        parameters=timer.variables,
        duration=_lasts(timer, part, part.subject),
        at_start=((timer.active, True), (_running(timer), False)),
        over_all=literals(root.conditions) if isinstance(root, Conditional) else (),
        start_effects=(PddlEffect(((_running(timer), True),)),),
        end_effects=(
            PddlEffect(
                (
                    (_running(timer), False),
                    (timer.active, False),
                    *literals(part.definition.fx),
                    *due,
                    *([(QUIET, False)] if due else []),
                )
            ),
        ),
    )


def _follow(timer: TimerFacts) -> PddlAction:
    definition = timer.root.definition
    if not isinstance(definition, Conditional):
        raise AssertionError(f"{timer.name} waits for nothing")
    condition = ((timer.active, True), *literals(definition.conditions))
    effect = PddlEffect(((timer.active, False), *literals(definition.fx)))
    return PddlAction(f"~follow:{timer.name}", timer.variables, condition, (effect,))
