"""Why an episode failed: the paper's taxonomy (appendix "Failure Mode Taxonomy Details").

The paper asks of which part of the decision process an agent was uncertain: the state (S), the
actions (A), the transition function (T), or the goal (G); people read each run and decided. Here
the same is told from what the world knows, so it can be had for every run, and repeated. Where it
needs the agent's reasoning (S, and a bad start), it only sees what is written in plain words.

The evidence is collected first; `classify` then weighs it as the appendix does:

1. Actions: the run ends with refused answers that name no action, or one out of reach.
2. State: near its end the agent still states as done what is not.
3. Transitions: a rule was violated, and the same action never worked afterwards.
4. Goal: what contradicts the goal is still there at the end, or the first reasoning left out what
   the goal asks for.
5. Else that of which there is most, a rule violation before the rest: recovering took too long.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from robotouille.world.grounding.objects import Atom
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World
from robotouille_evaluation.metrics.action_kinds import work_stations
from robotouille_evaluation.metrics.outcomes import success_within
from robotouille_evaluation.metrics.rows import Category
from robotouille_evaluation.metrics.trajectory import Answer, Trajectory, Verdict

__all__ = ["CATEGORIES", "Evidence", "Failure", "Subcategory", "classify", "evidence"]

LAST_SHARE = 0.75
"""Where the end of a run begins, as a share of its answers."""


class Subcategory(StrEnum):
    """What the uncertainty was about. "One item at a station" and "bad start" are the paper's own
    names; the paper gives the others by examples, not by names."""

    BELIEVED_DONE = "believed done"
    UNKNOWN_ACTION = "no such action"
    OUT_OF_REACH = "not possible there"
    ONE_ITEM = "one item at a station"
    ONE_PLAYER = "one player at a station"
    ONE_IN_HAND = "one thing in hand"
    OTHER_RULE = "another rule"
    BAD_START = "bad start"
    UNPREPARED = "unprepared ingredient"
    WRONG_INGREDIENT = "wrong ingredient"
    WRONG_ORDER = "wrong order"
    OUT_OF_STEPS = "out of steps"
    NOT_PLAYED = "broken off"


CATEGORIES = {
    Subcategory.BELIEVED_DONE: Category.STATE,
    Subcategory.UNKNOWN_ACTION: Category.ACTION,
    Subcategory.OUT_OF_REACH: Category.ACTION,
    Subcategory.ONE_ITEM: Category.TRANSITION,
    Subcategory.ONE_PLAYER: Category.TRANSITION,
    Subcategory.ONE_IN_HAND: Category.TRANSITION,
    Subcategory.OTHER_RULE: Category.TRANSITION,
    Subcategory.BAD_START: Category.GOAL,
    Subcategory.UNPREPARED: Category.GOAL,
    Subcategory.WRONG_INGREDIENT: Category.GOAL,
    Subcategory.WRONG_ORDER: Category.GOAL,
    Subcategory.OUT_OF_STEPS: Category.OTHER,
    Subcategory.NOT_PLAYED: Category.OTHER,
}


@dataclass(frozen=True, slots=True)
class Evidence:
    """One thing that speaks for a subcategory: after `step` steps, by whom, and in words.

    `lasting` says that it still mattered at the end: not recovered from, still stated, or still
    there.
    """

    step: int
    seat: str
    subcategory: Subcategory
    words: str
    lasting: bool = False

    @property
    def category(self) -> Category:
        """The category of its subcategory."""
        return CATEGORIES[self.subcategory]


@dataclass(frozen=True, slots=True)
class Failure:
    """Why an episode failed, and the evidence for it, step by step."""

    category: Category
    subcategory: Subcategory
    evidence: tuple[Evidence, ...] = ()

    @property
    def steps(self) -> tuple[int, ...]:
        """The steps of its evidence, each once."""
        return tuple(sorted({each.step for each in self.evidence}))


def classify(trajectory: Trajectory, budget: int) -> Failure | None:
    """Why an episode failed; None if it reached the goal within its budget."""
    if success_within(trajectory, budget):
        return None
    found = evidence(trajectory)
    for category in (Category.ACTION, Category.STATE, Category.TRANSITION, Category.GOAL):
        if lasting := [e for e in found if e.category is category and e.lasting]:
            return _failure(lasting)
    if found:
        counts = Counter(each.category for each in found)
        counts[Category.TRANSITION] *= len(found)
        ((category, _),) = counts.most_common(1)
        return _failure([each for each in found if each.category is category])
    whole = trajectory.steps >= budget
    subcategory = Subcategory.OUT_OF_STEPS if whole else Subcategory.NOT_PLAYED
    return Failure(Category.OTHER, subcategory)


def _failure(found: list[Evidence]) -> Failure:
    """Of one category, the subcategory with most evidence; of equal ones, the latest."""
    counts = Counter(each.subcategory for each in found)
    most = max(counts.values())
    chosen = next(e.subcategory for e in reversed(found) if counts[e.subcategory] == most)
    kept = tuple(each for each in found if each.subcategory is chosen)
    return Failure(CATEGORIES[chosen], chosen, kept)


def evidence(trajectory: Trajectory) -> list[Evidence]:
    """All that speaks for one failure or another, by step."""
    found = [
        *_refused(trajectory),
        *_stacked_where_work_is_done(trajectory),
        *_false_beliefs(trajectory),
        *_bad_starts(trajectory),
        *_against_the_goal(trajectory),
    ]
    return sorted(found, key=lambda each: (each.step, each.seat, each.subcategory))


# Actions and transitions: what was refused


def _refused(trajectory: Trajectory) -> Iterator[Evidence]:
    at_the_end = set(_wrong_at_the_end(trajectory.answers))
    for number, answer in enumerate(trajectory.answers):
        state = trajectory.states[answer.step]
        if not answer.wrong or _outrun(state, answer):
            continue
        subcategory = _broken_rule(state, answer)
        if subcategory is None:
            continue
        if CATEGORIES[subcategory] is Category.ACTION:
            lasting = number in at_the_end
        else:
            lasting = not _worked_later(trajectory.answers[number + 1 :], answer)
        words = answer.text if not answer.reasons else f"{answer.text}: {'; '.join(answer.reasons)}"
        yield Evidence(answer.step, answer.seat, subcategory, words, lasting)


def _outrun(state: State, answer: Answer) -> bool:
    """Whether the action applied, and was refused for what another did in the same step."""
    return answer.action is not None and state.world.applicable(state, answer.action)


def _wrong_at_the_end(answers: tuple[Answer, ...]) -> Iterator[int]:
    """The last answers of each seat, as long as they were refused."""
    for seat in {answer.seat for answer in answers}:
        for number in reversed(range(len(answers))):
            if answers[number].seat == seat:
                if not answers[number].wrong:
                    break
                yield number


def _worked_later(answers: Iterable[Answer], failed: Answer) -> bool:
    """Whether the seat did the same kind of action afterwards."""
    name = failed.action.name if failed.action else ""
    return any(
        not each.wrong and each.seat == failed.seat and each.action and each.action.name == name
        for each in answers
    )


def _broken_rule(state: State, answer: Answer) -> Subcategory | None:
    """Which rule a refused answer breaks; None where only its turn had not come."""
    if answer.verdict is Verdict.MALFORMED:
        return Subcategory.UNKNOWN_ACTION
    conditions = [u for u in answer.unmet if u.kind in (UnmetKind.CONDITION, UnmetKind.MISSING)]
    kinds = {_rule_of(state, each) for each in conditions}
    return next((kind for kind in _BY_WEIGHT if kind in kinds), None)


_BY_WEIGHT = (
    Subcategory.OUT_OF_REACH,
    Subcategory.ONE_PLAYER,
    Subcategory.ONE_IN_HAND,
    Subcategory.ONE_ITEM,
    Subcategory.OTHER_RULE,
)
"""Who is at the wrong place breaks other rules by the way: the first of these is the one."""


def _rule_of(state: State, unmet: Unmet) -> Subcategory:
    """The rule behind one unmet condition, told from what the domain's layout says of it."""
    domain = state.world.task.domain
    if unmet.kind is UnmetKind.MISSING:
        return Subcategory.OUT_OF_REACH
    rules = {rule.predicate: rule for rule in domain.layout or ()}
    types = next(p.param_types for p in domain.predicate_defs if p.name == unmet.predicate)
    of_players = bool({*domain.player_types} & {*types})
    of_stations = bool({*domain.station_types} & {*types})
    rule = rules.get(unmet.predicate)
    room = rule is not None and rule.unless is not None
    when = rule.when if rule else None
    if of_players:
        return Subcategory.ONE_IN_HAND if room else Subcategory.OUT_OF_REACH
    if room and of_stations:
        taken = {rules[name].when for name in (rule and rule.unless) or () if name in rules}
        return Subcategory.ONE_PLAYER if "faces" in taken else Subcategory.ONE_ITEM
    if when in ("bottom_of_stack", "next_in_stack"):
        near = [name for name, each in rules.items() if each.when == "shares_tile"]
        there = any(state.holds(name, *unmet.objects) for name in near)
        return Subcategory.ONE_ITEM if there else Subcategory.OUT_OF_REACH
    if when == "top_of_stack":
        return Subcategory.ONE_ITEM
    if when == "shares_tile" and of_stations:
        return Subcategory.OUT_OF_REACH
    return Subcategory.OTHER_RULE


def _stacked_where_work_is_done(trajectory: Trajectory) -> Iterator[Evidence]:
    """A second thing was put on one that lies where things are prepared: neither can be then."""
    world = trajectory.world
    stations = work_stations(world)
    for step, (before, joint, after) in enumerate(trajectory.each_step()):
        for move in joint:
            places = stations.intersection(move.action.arguments)
            if not move.applied or not places or not _pairs(world, before, after):
                continue
            pair = _pairs(world, before, after)[0]
            lasting = pair in trajectory.states[-1].atoms()
            yield Evidence(step, move.player, Subcategory.ONE_ITEM, move.action.sentence, lasting)


def _pairs(world: World, before: State, after: State) -> list[Atom]:
    """The facts that a step has added about two things of one type."""
    added, _ = world.changes(before, after)
    return [
        atom
        for atom in added
        if len(atom) == 3 and world.thing(atom[1]).type == world.thing(atom[2]).type
    ]


# The state: what was believed


def _false_beliefs(trajectory: Trajectory) -> Iterator[Evidence]:
    """Reasoning says of a thing that it is cooked, cut, fried, …, and it is not."""
    world = trajectory.world
    words = {p.removeprefix("is"): p for p in _prepared(world)}
    if not words:
        return
    claim = re.compile(
        rf"\b(\w+\d+) (?:is|has been|was) (?:now |already |fully )*({'|'.join(sorted(words))})\b"
    )
    late = LAST_SHARE * len(trajectory.answers)
    for number, answer in enumerate(trajectory.answers):
        for sentence in re.split(r"[.;\n]", answer.reasoning.casefold()):
            if _CONDITIONAL.search(sentence):
                continue
            for thing, word in claim.findall(sentence):
                state = trajectory.states[answer.step]
                if thing in world.thing_names and not state.holds(words[word], thing):
                    text = f"says that {thing} is {word}"
                    yield Evidence(
                        answer.step,
                        answer.seat,
                        Subcategory.BELIEVED_DONE,
                        text,
                        lasting=number >= late,
                    )


_CONDITIONAL = re.compile(r"\b(if|once|until|after|when|while|ensure|check|whether|must|should)\b")


def _prepared(world: World) -> frozenset[str]:
    """The predicates that special effects bring about and leave: `iscut`, `iscooked`, …"""
    found = set()
    for schema in world.schemas:
        stack = list(schema.definition.sfx)
        while stack:
            effect = stack.pop()
            stack += effect.sfx
            if effect.type in ("delayed", "repetitive"):
                found |= {f.predicate for f in effect.fx if f.is_true and len(f.params) == 1}
    return frozenset(found)


# The goal: what was understood, and what was made


def _bad_starts(trajectory: Trajectory) -> Iterator[Evidence]:
    """A seat's first reasoning speaks of the goal, and not of everything that it is made of."""
    world = trajectory.world
    kinds = sorted(_ingredients(world))
    seen: set[str] = set()
    for answer in trajectory.answers:
        if answer.seat in seen or not answer.reasoning:
            continue
        seen.add(answer.seat)
        said = re.sub(r"[^a-z]", "", answer.reasoning.casefold())
        missing = [kind for kind in kinds if kind not in said]
        if missing and "goal" in said:
            words = f"the first reasoning does not name: {', '.join(missing)}"
            yield Evidence(answer.step, answer.seat, Subcategory.BAD_START, words, lasting=True)


def _ingredients(world: World) -> frozenset[str]:
    """The kinds of things, neither stations nor players, that the goal speaks of and are there."""
    domain = world.task.domain
    places = {*domain.station_types, *domain.player_types}
    there = {thing.kind for thing in world.placed if thing.type not in places}
    return frozenset(k for t in world.goal.terms for k in t.args) & there


def _against_the_goal(trajectory: Trajectory) -> Iterator[Evidence]:
    """Things put together in a way that the goal does not ask for."""
    world, last = trajectory.world, trajectory.states[-1]
    wishes, stations = _Wishes(world), work_stations(world)
    for step, (before, joint, after) in enumerate(trajectory.each_step()):
        for move in joint:
            if not move.applied or stations.intersection(move.action.arguments):
                continue
            for atom in _things_joined(world, before, after):
                if not {*atom[1:]} & {*move.action.arguments}:
                    continue
                subcategory = wishes.contradiction(atom, after)
                if subcategory is not None:
                    stays = last.holds(*atom) and wishes.contradiction(atom, last) is not None
                    yield Evidence(step, move.player, subcategory, move.action.sentence, stays)


def _things_joined(world: World, before: State, after: State) -> list[Atom]:
    """The facts that a step has added about two things, neither a station nor a player."""
    domain = world.task.domain
    places = {*domain.station_types, *domain.player_types}
    added, _ = world.changes(before, after)
    return [
        atom
        for atom in added
        if len(atom) == 3 and not any(world.thing(name).type in places for name in atom[1:])
    ]


class _Wishes:
    """What a goal asks for, by kinds of things."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._kinds = _ingredients(world)
        prepared = _prepared(world)
        kind_of = {identifier: v.kind for identifier, v in world.goal.variables.items()}
        self._pairs: dict[str, set[tuple[str, ...]]] = {}
        asked: dict[str, dict[int | str, set[str]]] = {}
        for term in world.goal.terms:
            if len(term.ids) == 2:
                self._pairs.setdefault(term.predicate, set()).add(term.args)
            for identifier in term.ids:
                asked.setdefault(kind_of[identifier], {}).setdefault(identifier, set())
            if len(term.ids) == 1 and term.predicate in prepared:
                asked[kind_of[term.ids[0]]][term.ids[0]].add(term.predicate)
        self._wanted = {
            kind: set.intersection(*each.values()) for kind, each in asked.items() if each
        }

    def contradiction(self, atom: Atom, state: State) -> Subcategory | None:
        """What is wrong with a pair of things in a state; None if nothing is.

        A thing is unprepared if every one of its kind in the goal must be what it is not.
        """
        kinds = tuple(self._world.thing(name).kind for name in atom[1:])
        first, name = kinds[0], atom[1]
        if first in {t.kind for t in self._world.placed} and first not in self._kinds:
            return Subcategory.WRONG_INGREDIENT
        if any(not state.holds(p, name) for p in self._wanted.get(first, ())):
            return Subcategory.UNPREPARED
        pairs = self._pairs.get(atom[0])
        if pairs and kinds not in pairs and {k for pair in pairs for k in pair} >= set(kinds):
            return Subcategory.WRONG_ORDER
        return None
