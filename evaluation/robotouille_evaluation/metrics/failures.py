"""Causes of failed episodes, by the paper's appendix "Failure Mode Taxonomy Details".

The paper asks which part of the decision process an agent was uncertain about: the state (S), the
actions (A), the transition function (T), or the goal (G). For the paper, people read each run and
decided. This module decides from the states and answers, so its results are repeatable. In the
agent's reasoning (used for S and bad starts), it recognizes only plain statements.

The module first collects evidence. `classify` then weighs it as the appendix does:

1. Actions: the run ends with rejected answers that name no action, or an action out of reach.
2. State: near the end the agent still claims that something is done although it is not.
3. Transitions: a rule was violated, and the same action never worked afterwards.
4. Goal: something still contradicts the goal at the end, or the first reasoning omitted a part of
   the goal.
5. Otherwise: the category with most evidence. Rule violations outweigh all other evidence, because
   the agent took too long to recover from them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from robotouille.world.grounding.objects import Atom
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World
from robotouille_evaluation.metrics.asynchrony import work_stations
from robotouille_evaluation.metrics.failure_kinds import CATEGORIES, TOGETHER, Subcategory
from robotouille_evaluation.metrics.goal_requirements import (
    GoalRequirements,
    ingredients,
    prepared_predicates,
)
from robotouille_evaluation.metrics.outcomes import success_within
from robotouille_evaluation.metrics.rows import Category
from robotouille_evaluation.metrics.trajectory import AnswerVerdict, StepAnswer, Trajectory

LAST_SHARE = 0.75
"""Answers and steps after this share of all count as the end of a run."""
LOOP = 3
"""Number of equal steps, in equal states, that are a loop."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence for a subcategory: what a seat did or said after `step` steps.

    Evidence is `lasting` if it mattered at the end: the agent had not recovered from it, still
    claimed it, or had not removed it.
    """

    step: int
    seat: str
    subcategory: Subcategory
    words: str
    lasting: bool = False

    @property
    def category(self) -> Category:
        """Category of the subcategory."""
        return CATEGORIES[self.subcategory]


@dataclass(frozen=True, slots=True)
class Failure:
    """Cause of a failed episode, with its evidence."""

    category: Category
    subcategory: Subcategory
    evidence: tuple[Evidence, ...] = ()

    @property
    def steps(self) -> tuple[int, ...]:
        """Steps of the evidence, each once."""
        return tuple(sorted({each.step for each in self.evidence}))


def classify(trajectory: Trajectory, budget: int) -> Failure | None:
    """Return why an episode failed; None if it reached the goal in time, and for a shift."""
    if trajectory.world.shift is not None or success_within(trajectory, budget):
        return None
    found = evidence(trajectory)
    for category in (Category.ACTION, Category.STATE, Category.TRANSITION, Category.GOAL):
        if lasting := [e for e in found if e.category is category and e.lasting]:
            return _failure(lasting)
    if found:
        counts = Counter(each.category for each in found)
        # This factor lets a single rule violation outweigh any amount of other evidence.
        counts[Category.TRANSITION] *= len(found)
        ((category, _),) = counts.most_common(1)
        return _failure([each for each in found if each.category is category])
    whole = trajectory.steps >= budget
    subcategory = Subcategory.OUT_OF_STEPS if whole else Subcategory.NOT_PLAYED
    return Failure(Category.OTHER, subcategory)


def _failure(found: list[Evidence]) -> Failure:
    """Return a failure of the subcategory with most evidence; the latest one wins a tie.

    Of the two rules, or the two uncertainties, both are named if both have evidence.
    """
    counts = Counter(each.subcategory for each in found)
    most = max(counts.values())
    chosen = next(e.subcategory for e in reversed(found) if counts[e.subcategory] == most)
    meant = {chosen}
    for both, parts in TOGETHER.items():
        if chosen in parts and parts <= counts.keys():
            chosen, meant = both, parts
    kept = tuple(each for each in found if each.subcategory in meant)
    return Failure(CATEGORIES[chosen], chosen, kept)


def evidence(trajectory: Trajectory) -> list[Evidence]:
    """Return all evidence for any cause, by step."""
    found = [
        *_rejected(trajectory),
        *_stacked_where_work_is_done(trajectory),
        *_loops(trajectory),
        *_false_beliefs(trajectory),
        *_bad_starts(trajectory),
        *_against_the_goal(trajectory),
    ]
    return sorted(found, key=lambda each: (each.step, each.seat, each.subcategory))


# Actions and transitions: rejected answers


def _rejected(trajectory: Trajectory) -> Iterator[Evidence]:
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


def _outrun(state: State, answer: StepAnswer) -> bool:
    """Return whether an action was valid, but another action in the same step prevented it."""
    return answer.action is not None and state.world.applicable(state, answer.action)


def _wrong_at_the_end(answers: tuple[StepAnswer, ...]) -> Iterator[int]:
    """Yield the numbers of the rejected answers after each seat's last accepted one."""
    for seat in {answer.seat for answer in answers}:
        for number in reversed(range(len(answers))):
            if answers[number].seat == seat:
                if not answers[number].wrong:
                    break
                yield number


def _worked_later(answers: Iterable[StepAnswer], failed: StepAnswer) -> bool:
    """Return whether the seat applied the same kind of action afterwards."""
    name = failed.action.name if failed.action else ""
    return any(
        not each.wrong and each.seat == failed.seat and each.action and each.action.name == name
        for each in answers
    )


def _broken_rule(state: State, answer: StepAnswer) -> Subcategory | None:
    """Return the rule that a rejected answer breaks; None if it was, for example, out of turn."""
    if answer.verdict is AnswerVerdict.MALFORMED:
        return Subcategory.INVALID_ACTION
    conditions = [u for u in answer.unmet if u.kind in (UnmetKind.CONDITION, UnmetKind.MISSING)]
    kinds = {_rule_of(state, each) for each in conditions}
    return next((kind for kind in _BY_WEIGHT if kind in kinds), None)


_BY_WEIGHT = (
    Subcategory.INVALID_ACTION,
    Subcategory.ONE_PLAYER,
    Subcategory.ONE_IN_HAND,
    Subcategory.ONE_ITEM,
    Subcategory.OTHER_RULE,
)
"""Order of precedence, since a player at the wrong station also breaks other rules."""


def _rule_of(state: State, unmet: Unmet) -> Subcategory:
    """Return the rule behind an unmet condition, from the domain's layout rules."""
    domain = state.world.task.domain
    if unmet.kind is UnmetKind.MISSING:
        return Subcategory.INVALID_ACTION
    rules = {rule.predicate: rule for rule in domain.layout or ()}
    types = next(p.param_types for p in domain.predicate_defs if p.name == unmet.predicate)
    of_players = bool({*domain.player_types} & {*types})
    of_stations = bool({*domain.station_types} & {*types})
    rule = rules.get(unmet.predicate)
    room = rule is not None and rule.unless is not None
    when = rule.when if rule else None
    if of_players:
        return Subcategory.ONE_IN_HAND if room else Subcategory.INVALID_ACTION
    if room and of_stations:
        taken = {rules[name].when for name in (rule and rule.unless) or () if name in rules}
        return Subcategory.ONE_PLAYER if "faces" in taken else Subcategory.ONE_ITEM
    if when in ("bottom_of_stack", "next_in_stack"):
        near = [name for name, each in rules.items() if each.when == "shares_tile"]
        there = any(state.holds(name, *unmet.objects) for name in near)
        return Subcategory.ONE_ITEM if there else Subcategory.INVALID_ACTION
    if when == "top_of_stack":
        return Subcategory.ONE_ITEM
    if when == "shares_tile" and of_stations:
        return Subcategory.INVALID_ACTION
    return Subcategory.OTHER_RULE


def _stacked_where_work_is_done(trajectory: Trajectory) -> Iterator[Evidence]:
    """Yield the steps that stacked two things at a work station, where neither can be prepared."""
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


def _loops(trajectory: Trajectory) -> Iterator[Evidence]:
    """Yield the steps of a loop that clears a work station and occupies it again.

    In the paper's example, an agent follows the rules in turn: it picks a thing up because the
    station must be free, and puts it back because its hand must be free.
    """
    stations = work_stations(trajectory.world)
    late = LAST_SHARE * trajectory.steps
    times: Counter[tuple[State, str, str]] = Counter()
    for step, (before, joint, _) in enumerate(trajectory.each_step()):
        for move in joint:
            action = move.action
            handles = action.destination is None and not action.effects
            if not move.applied or not handles or not stations.intersection(action.arguments):
                continue
            key = (before, move.player, action.sentence)
            times[key] += 1
            if times[key] >= LOOP:
                yield Evidence(
                    step, move.player, Subcategory.ONE_ITEM, action.sentence, step >= late
                )


def _pairs(world: World, before: State, after: State) -> list[Atom]:
    """Return the facts that a step added about two things of one type."""
    added, _ = world.changes(before, after)
    return [
        atom
        for atom in added
        if len(atom) == 3 and world.thing(atom[1]).type == world.thing(atom[2]).type
    ]


# The state: false claims


def _false_beliefs(trajectory: Trajectory) -> Iterator[Evidence]:
    """Yield false claims in the reasoning that a thing is cooked, cut, fried and so on."""
    world = trajectory.world
    words = {p.removeprefix("is"): p for p in prepared_predicates(world)}
    if not words:
        return
    claim = re.compile(
        rf"\b(\w+\d+) (?:is|has been|was) (?:now |already |fully )*({'|'.join(sorted(words))})\b"
    )
    late = LAST_SHARE * len(trajectory.answers)
    for number, answer in enumerate(trajectory.answers):
        for sentence in re.split(r"[.;\n]", answer.reasoning.casefold()):
            # "Once the lettuce is cut" is a plan and not a claim.
            if _CONDITIONAL.search(sentence):
                continue
            for thing, word in claim.findall(sentence):
                state = trajectory.states[answer.step]
                if thing in world.thing_names and not state.holds(words[word], thing):
                    text = f"claims that {thing} is {word}"
                    yield Evidence(
                        answer.step,
                        answer.seat,
                        Subcategory.PREDICATES,
                        text,
                        lasting=number >= late,
                    )


_CONDITIONAL = re.compile(r"\b(if|once|until|after|when|while|ensure|check|whether|must|should)\b")


# The goal: bad starts and contradictions


def _bad_starts(trajectory: Trajectory) -> Iterator[Evidence]:
    """Yield each seat's first reasoning if it mentions the goal but not all ingredients."""
    world = trajectory.world
    kinds = sorted(ingredients(world))
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


def _against_the_goal(trajectory: Trajectory) -> Iterator[Evidence]:
    """Yield the steps that joined things in a way that contradicts the goal."""
    world, last = trajectory.world, trajectory.states[-1]
    required, stations = GoalRequirements(world), work_stations(world)
    for step, (before, joint, after) in enumerate(trajectory.each_step()):
        for move in joint:
            if not move.applied or stations.intersection(move.action.arguments):
                continue
            for atom in _things_joined(world, before, after):
                if not {*atom[1:]} & {*move.action.arguments}:
                    continue
                subcategory = required.contradiction(atom, after)
                if subcategory is not None:
                    stays = last.holds(*atom) and required.contradiction(atom, last) is not None
                    yield Evidence(step, move.player, subcategory, move.action.sentence, stays)


def _things_joined(world: World, before: State, after: State) -> list[Atom]:
    """Return the facts that a step added about two items or containers."""
    domain = world.task.domain
    places = {*domain.station_types, *domain.player_types}
    added, _ = world.changes(before, after)
    return [
        atom
        for atom in added
        if len(atom) == 3 and not any(world.thing(name).type in places for name in atom[1:])
    ]
