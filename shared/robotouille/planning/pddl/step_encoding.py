"""The step encoding: classical PDDL in which a plan's cost equals its steps in the world.

The seats act or pass one after another. Then the action `tick` costs 1 and updates every running
effect. Counters are facts over the numbers `n0`, `n1` and so on.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

from robotouille.domain.schema import Creation
from robotouille.planning.pddl.lifted import (
    DONE,
    SEAT,
    THERE,
    Lifted,
    candidate_facts,
    candidate_predicates,
    finish,
    follows,
    fresh,
)
from robotouille.planning.pddl.syntax import (
    Literal,
    PddlAction,
    PddlDomain,
    PddlEffect,
    PddlProblem,
    Term,
    Variable,
)
from robotouille.planning.pddl.timer_facts import (
    NUMBER,
    QUIET,
    SymbolicRun,
    TimerFacts,
    TimerPart,
    effects_of,
    literals,
    perform,
    runs,
    tick,
)
from robotouille.world.grounding.actions import ActionSchema


def instant_name(timer: TimerFacts, part: TimerPart) -> str:
    """Return the name of a creation or deletion action, such as `create-fill-pot-0-2`."""
    return f"~{part.definition.type}:{timer.name}:{part.slot}"


def instant_actions(lifted: Lifted) -> Iterator[PddlAction]:
    """Yield an action for each creation and deletion, and `go-on` if there are any."""
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
    """Yield the start of nested effects, except those about a deleted object."""
    for definition in part.definition.sfx:
        timer = lifted.born[id(definition)]
        if deleted not in dict(timer.variables):
            for literal in timer.start:
                yield PddlEffect((literal,), ((timer.active, False),))


def _forget(lifted: Lifted, subject: str, kind: str) -> Iterator[PddlEffect]:
    """Yield effects that make every fact about an object false and stop the effects about it."""
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


ACTOR, CLOCK = "~actor", "~clock"
_FIRST: Variable = ("?~first", SEAT)
REQUIREMENTS = (
    ":strips", ":typing", ":negative-preconditions", ":equality", ":conditional-effects",
    ":action-costs",
)  # fmt: skip


def encode_steps(lifted: Lifted) -> tuple[PddlDomain, PddlProblem]:
    """Return the domain and problem of a world."""
    quiet: tuple[Literal, ...] = ((QUIET, True),) if lifted.instants else ()
    numbers = numbers_of(lifted)
    domain = PddlDomain(
        requirements=REQUIREMENTS,
        types={ACTOR: "object", SEAT: ACTOR, **lifted.types, NUMBER: "object"},
        constants=((CLOCK, ACTOR), *numbers[:2], *lifted.constants),
        predicates={
            **lifted.predicates,
            **candidate_predicates(lifted),
            **({QUIET[0]: ()} if quiet else {}),
            "~turn": (ACTOR,),
            "~then": (ACTOR, ACTOR),
            "~next": (NUMBER, NUMBER),
            DONE[0]: (),
        },
        functions={"total-cost": ()},
        actions=(
            *(_act(lifted, schema, quiet) for schema in lifted.schemas),
            _pass(quiet),
            _tick(lifted, quiet),
            *instant_actions(lifted),
            finish(lifted, (_FIRST,), (*_turn(_FIRST[0]), _after(CLOCK, _FIRST[0]), *quiet)),
        ),
        notes=_notes(lifted),
    )
    problem = PddlProblem(
        objects=(*lifted.objects, *numbers[2:]),
        facts=tuple(_facts(lifted, numbers)),
        goal=DONE,
        metric="total-cost",
        values={("total-cost",): 0},
    )
    return domain, problem


def numbers_of(lifted: Lifted) -> list[Variable]:
    """Return the numbers from zero to the highest count."""
    highest = max((count for _, count in lifted.last_counts()), default=-1)
    return [(f"~n{i}", NUMBER) for i in range(max(2, highest + 1) if highest >= 0 else 0)]


def successions(numbers: list[Variable]) -> Iterator[Term]:
    """Yield the successor relation of the numbers."""
    return (("~next", one, other) for (one, _), (other, _) in pairwise(numbers))


def _notes(lifted: Lifted) -> tuple[str, ...]:
    task = lifted.world.task
    notes = [
        f"{task.name}@{task.seats}, step encoding: a plan's cost is its number of steps.",
        "See docs/planners.md.",
    ]
    return (*notes, *lifted.bounds())


def _turn(who: str) -> tuple[Literal, ...]:
    return ((("~turn", who), True),)


def _after(who: str, following: str) -> Literal:
    return (("~then", who, following), True)


def _hand_over(who: str, following: str) -> tuple[Literal, ...]:
    return ((("~turn", who), False), (("~turn", following), True))


def _act(lifted: Lifted, schema: ActionSchema, quiet: tuple[Literal, ...]) -> PddlAction:
    parameters = lifted.parameters(schema)
    seat = parameters[0][0] if schema.player else "?~seat"
    others = () if schema.player else ((seat, SEAT),)
    alone = len(lifted.world.players) == 1
    condition = lifted.condition(schema)
    return PddlAction(
        schema.name,
        (*parameters, *others, ("?~next", ACTOR)),
        (*_turn(seat), _after(seat, "?~next"), *quiet, *condition),
        (PddlEffect(_hand_over(seat, "?~next")), *acting(lifted, schema, ends_now=alone)),
    )


def acting(lifted: Lifted, schema: ActionSchema, *, ends_now: bool) -> Iterator[PddlEffect]:
    """Yield the immediate effects of an action and the effects that it starts or updates.

    `ends_now` means that no other player can have completed an effect in the same step.
    """

    def perform_all(run: SymbolicRun) -> None:
        run.write(*literals(schema.definition.immediate_fx))
        for timer in lifted.own[schema.name]:
            perform(run, timer)

    fresh = ((timer.over, False) for timer in lifted.own[schema.name] if ends_now)
    return effects_of(runs(perform_all, (*lifted.condition(schema), *fresh)))


def _pass(quiet: tuple[Literal, ...]) -> PddlAction:
    return PddlAction(
        "~pass",
        (("?~seat", SEAT), ("?~next", ACTOR)),
        (*_turn("?~seat"), _after("?~seat", "?~next"), *quiet),
        (PddlEffect(_hand_over("?~seat", "?~next")),),
    )


def _tick(lifted: Lifted, quiet: tuple[Literal, ...]) -> PddlAction:
    effects = [
        effect
        for timer in lifted.timers
        for effect in effects_of(runs(partial(tick, timer=timer)), timer.variables)
    ]
    return PddlAction(
        "~tick",
        (_FIRST,),
        (*_turn(CLOCK), _after(CLOCK, _FIRST[0]), *quiet),
        (PddlEffect(_hand_over(CLOCK, _FIRST[0])), *effects),
        cost=1,
    )


def _facts(lifted: Lifted, numbers: list[Variable]) -> Iterator[Term]:
    order = [*lifted.world.players, CLOCK, lifted.world.players[0]]
    yield ("~turn", order[0])
    yield from (("~then", *pair) for pair in pairwise(order))
    yield from lifted.facts()
    yield from successions(numbers)
    yield from ((*term, f"~n{count}") for term, count in lifted.last_counts())
    yield from candidate_facts(lifted)
