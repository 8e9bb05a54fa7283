"""The step encoding: classical PDDL whose plans cost exactly the steps they take in the world.

One after the other, each seat acts or passes; then the action `tick` costs 1 and updates every
running effect. Counters are facts over the numbers `n0`, `n1`, …
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

from robotouille.planning.pddl.lifting.goal_action import (
    DONE,
    candidate_facts,
    candidate_predicates,
    finish,
)
from robotouille.planning.pddl.lifting.instants import instant_actions
from robotouille.planning.pddl.lifting.lifted import SEAT, Lifted
from robotouille.planning.pddl.lifting.symbolic_runs import SymbolicRun, effects_of, runs
from robotouille.planning.pddl.lifting.timer_facts import NUMBER, QUIET, literals, perform, tick
from robotouille.planning.pddl.syntax import (
    Literal,
    PddlAction,
    PddlDomain,
    PddlEffect,
    PddlProblem,
    Term,
    Variable,
)
from robotouille.world.grounding.actions import ActionSchema

__all__ = ["acting", "encode_steps", "numbers_of", "successions"]

ACTOR, CLOCK = "~actor", "~clock"
_FIRST: Variable = ("?~first", SEAT)
REQUIREMENTS = (
    ":strips", ":typing", ":negative-preconditions", ":equality", ":conditional-effects",
    ":action-costs",
)  # fmt: skip


def encode_steps(lifted: Lifted) -> tuple[PddlDomain, PddlProblem]:
    """The domain and problem of a world."""
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
    """As many numbers as the highest count needs."""
    highest = max((count for _, count in lifted.last_counts()), default=-1)
    return [(f"~n{i}", NUMBER) for i in range(max(2, highest + 1) if highest >= 0 else 0)]


def successions(numbers: list[Variable]) -> Iterator[Term]:
    """Which number follows which."""
    return (("~next", one, other) for (one, _), (other, _) in pairwise(numbers))


def _notes(lifted: Lifted) -> tuple[str, ...]:
    task = lifted.world.task
    notes = [
        f"{task.name}@{task.seats}, in steps: a plan costs the steps that it takes.",
        "See docs/pddl.md.",
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
    """What an action does at once: its immediate effects, and those that it starts or drives.

    `ends_now` says that no effect has completed earlier in the same step, e.g. by another player.
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
