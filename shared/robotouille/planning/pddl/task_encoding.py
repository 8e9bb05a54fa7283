"""Encoding of a task as a PDDL domain and problem, in one of two styles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

from robotouille.domain.schema import (
    Conditional,
    Creation,
    Delayed,
    Deletion,
    Repetitive,
)
from robotouille.errors import RobotouilleError
from robotouille.planning.pddl.lifted import (
    DONE,
    SEAT,
    Lifted,
    candidate_facts,
    candidate_predicates,
    finish,
    roomy,
)
from robotouille.planning.pddl.step_encoding import (
    acting,
    encode_steps,
    instant_actions,
    numbers_of,
    successions,
)
from robotouille.planning.pddl.syntax import (
    DurativeAction,
    Literal,
    PddlAction,
    PddlDomain,
    PddlEffect,
    PddlNames,
    PddlProblem,
    Term,
    Variable,
)
from robotouille.planning.pddl.timer_facts import (
    NUMBER,
    QUIET,
    TimerFacts,
    TimerPart,
    literals,
    runs,
    tick,
)
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.world import World

EXPRESSIBLE = (Conditional, Delayed, Repetitive, Creation, Deletion)
"""Kinds of effects that both encodings can express."""


class PddlError(RobotouilleError):
    """A task that cannot be encoded in PDDL."""


def check(lifted: Lifted) -> None:
    """Check that a world can be encoded.

    Raises:
        PddlError: The timing is not `benchmark`, the world has no players, or an effect reads facts
            at the end of a step that another effect changes there.
    """
    task = lifted.world.task
    if task.profile.steps_per_tile or task.profile.repeat_steps > 1:
        raise PddlError(f"PDDL export needs the timing 'benchmark', found {task.timing.value!r}")
    if not lifted.world.players:
        raise PddlError(f"{task.name} has no players")
    for timer in lifted.timers:
        for part in timer.parts:
            # Without this check, a new kind of effect would be written as one that never ends.
            if not isinstance(part.definition, EXPRESSIBLE):
                raise PddlError(f"PDDL cannot express effects of kind {part.definition.type!r}")
    for writer in lifted.timers:
        for reader in lifted.timers:
            for term in _tested(lifted, reader):
                if any(_clash(writer, reader, other, term) for other in _written(writer)):
                    raise PddlError(
                        f"an effect of {writer.action!r} changes {term[0]!r} at the end of a step "
                        f"and one of {reader.action!r} depends on it: the world updates them in "
                        "the order in which they began, which PDDL cannot express"
                    )


def _written(timer: TimerFacts) -> Iterator[Term]:
    """Yield the atoms that a passive update can change, without those about created objects."""
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
    """Return whether two different effects may be about the same atom."""
    if written[0] != tested[0]:
        return False
    itself = {name for name, _ in writer.variables} <= set(written)
    return not (writer is reader and written == tested and itself)


REQUIREMENTS = (
    ":strips", ":typing", ":negative-preconditions", ":equality", ":conditional-effects",
    ":durative-actions", ":fluents",
)  # fmt: skip


def encode_durative(lifted: Lifted) -> tuple[PddlDomain, PddlProblem]:
    """Return the domain and problem of a world with durative actions.

    Raises:
        PddlError: The world has effects that this encoding cannot express.
    """
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
        f"{task.name}@{task.seats}, durative encoding: delays do not pause. See docs/planners.md.",
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
    """Return an effect without the facts that only the step encoding needs.

    The result is empty if the effect depends on one of them.
    """
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
    """Return the predicates for pauses and the ends of steps."""
    found = set()
    for timer in lifted.timers:
        found.add(timer.over[0])
        for part in timer.parts:
            found.add(timer.holding(part)[0])
            if isinstance(part.definition, Delayed):
                found |= {timer.count(part, "")[0], timer.last(part, "", "")[0]}
    return found


def _delays(timer: TimerFacts) -> Iterator[TimerPart]:
    """Yield the delay of an effect, if any.

    Raises:
        PddlError: The effect's shape cannot be encoded.
    """
    part = timer.root
    if isinstance(part.definition, Conditional) and len(part.nested) == 1:
        part = part.nested[0]
    if isinstance(part.definition, Delayed) and not part.lasts:
        yield part
    elif part is not timer.root or part.lasts:
        raise PddlError(
            f"the durative encoding supports delays in at most one condition; {timer.action!r} has "
            "an effect of another shape: use the step encoding"
        )


def _follows(timer: TimerFacts) -> bool:
    """Return whether an effect only waits for its conditions."""
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


class EncodingStyle(StrEnum):
    """Representation of time: exact steps, or durative actions without pauses."""

    STEPS = "steps"
    DURATIVE = "durative"


@dataclass(frozen=True)
class PddlEncoding:
    """The texts of the two files, and the data for reading plans."""

    domain: str
    problem: str
    lifted: Lifted
    names: PddlNames


def encode(
    world: World, style: EncodingStyle = EncodingStyle.STEPS, *, created: int | None = None
) -> PddlEncoding:
    """Encode a task in PDDL, with room for `created` objects of each kind.

    Raises:
        PddlError: The task cannot be encoded in this style.
    """
    lifted = Lifted(roomy(world, created))
    check(lifted)
    names = PddlNames(lifted.world)
    write = encode_steps if style is EncodingStyle.STEPS else encode_durative
    domain, problem = write(lifted)
    return PddlEncoding(domain.text(names), problem.text(names), lifted, names)
