"""Near misses: the action that an input most nearly means, and what has to be done before it.

Pure functions of a state: object names in, words out. The caller decides what an input may mean.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import Occupancy, changes_something, work_in_progress
from robotouille.world.scene import Placed
from robotouille.world.unmet import Unmet
from robotouille.world.world import State, World

# This bounds the time that a key press takes in a large kitchen.
_MAX_ATTEMPTS = 2000
# An action that lacks more than this is too far off to be hinted at.
_MAX_UNMET = 2


class _Rank(NamedTuple):
    """Sort key of an action that is not possible now; the least is the nearest miss.

    Walking to an occupied place comes before acting there (`acts`). The other fields, most
    important first: `never` counts conditions that no action can change at this place; `vain`
    marks actions that would change nothing; `aside` marks actions without any held object; `far`
    marks actions that lack several conditions and do not serve the goal; `about` is minus the
    number of objects involved; `missing` counts unmet conditions.
    """

    acts: bool
    never: int
    vain: bool
    aside: bool
    far: bool
    about: int
    missing: int


@dataclass(frozen=True, slots=True)
class InputBinding:
    """Action that an input may mean, and the parameter that the input sets, if any."""

    schema: ActionSchema
    parameter: str | None


class Situation:
    """State as one player meets it: where the player stands and what it holds."""

    def __init__(self, state: State, me: str, placed: dict[str, Placed]) -> None:
        self.state = state
        self.me = me
        self.placed = placed
        self.at = placed[me].at if me in placed else None
        self.held = frozenset(things_upon(me, placed))


@dataclass(frozen=True, slots=True)
class NearMiss:
    """Hint for an input that can do nothing now.

    Attributes:
        action: The action it would be; None if that cannot even be tried.
        advice: True if the words say what to do.
    """

    action: GroundAction | None
    words: str
    advice: bool = True


class NearMisses:
    """Finds the nearest miss of a player's input, in that player's wording."""

    def __init__(self, world: World, wording: Wording) -> None:
        self._world = world
        self._words = wording
        self._preparation = wording.preparation
        self._occupancy = Occupancy(world)

    def nearest(
        self, situation: Situation, bindings: list[InputBinding], meant: list[str], *, at_work: bool
    ) -> NearMiss:
        """Return the action nearest to being possible, or the work that must come before it.

        Args:
            meant: Objects the input may be about, the most likely first.
            at_work: True while work goes on here. Actions that can never follow it are left out.
        """
        near = _near(situation.me, meant, situation.placed)
        # Objects that do not exist yet need hints of their own, since no action with them can be
        # tried.
        tried = self._tried(situation, bindings, meant, near, at_work=at_work)
        found = min(tried, key=lambda one: one[0], default=None)
        unmade = min(self._unmade(situation, bindings, meant, near), default=None)
        if unmade is not None and (found is None or unmade[0] < found[0]):
            return NearMiss(None, capitalised(unmade[1]))
        if found is None:
            return self._nothing(situation, bindings, meant)
        rank, action, unmet = found
        way = capitalised(self._words.way(action, unmet, situation.state))
        does = capitalised(self._words.action(action, situation.state))
        return NearMiss(action, way if not rank.acts else f"{does}? {way}")

    def _nothing(
        self, situation: Situation, bindings: list[InputBinding], meant: list[str]
    ) -> NearMiss:
        """Return what an empty place is for, or that there is nothing to do."""
        if any(row.running and row.subject in meant for row in work_in_progress(situation.state)):
            return NearMiss(None, self._words.language.work.under_way)
        there = [name for name in meant[:1] if name != situation.me]
        if len(meant) == 1 and not situation.held and meant[0] == situation.at:
            schemas = [each.schema for each in bindings if self.is_for(each, meant[0])]
            if words := self._words.here(schemas):
                return NearMiss(None, capitalised(words))
        where = self._words.thing(there[0], situation.state) if there else ""
        words = f"nothing to do at {where}" if where else "nothing to do here"
        return NearMiss(None, words, advice=False)

    def is_for(self, binding: InputBinding, station: str) -> bool:
        """Return whether an action needs such a station, and objects that exist in this task."""
        table, schema = self._world.table, binding.schema
        needs = [e for e in schema.definition.precons if e.predicate in table.static_predicates]
        here = [each.predicate for each in needs if each.params == (binding.parameter,)]
        there_is = {atom[0] for atom in table.static}
        about = len(schema.parameters) - schema.player > 1
        return (
            about
            and bool(here)
            and all((each, station) in table.static for each in here)
            and all(each.predicate in there_is for each in needs if each.is_true)
        )

    # Actions that can be tried

    def _tried(
        self,
        situation: Situation,
        bindings: list[InputBinding],
        meant: list[str],
        near: list[str],
        *,
        at_work: bool,
    ) -> Iterator[tuple[_Rank, GroundAction, tuple[Unmet, ...]]]:
        for binding in bindings:
            for arguments in self._arguments(binding, situation.me, meant, near):
                if None in arguments:
                    continue
                names = tuple(name for name in arguments if name is not None)
                action = self._world.action(binding.schema.name, *names)
                unmet = self._world.unmet(situation.state, action)
                rank = self._rank(situation, action, unmet, meant)
                if rank is not None and not (at_work and rank.never):
                    yield rank, action, unmet

    def _rank(
        self, situation: Situation, action: GroundAction, unmet: tuple[Unmet, ...], meant: list[str]
    ) -> _Rank | None:
        """Return the rank of an action, or None if it is not worth a hint."""
        never = [each for each in unmet if self._is_for_ever(each)]
        vain = not changes_something(situation.state, action)
        if not 0 < len(unmet) <= _MAX_UNMET or len(never) > 1:
            return None
        if (vain and all(each.expected for each in unmet)) or any(map(self._is_nowhere, never)):
            return None
        here = meant[:1] == [situation.at]
        if never and here and {*action.arguments} <= {situation.me, *meant[:1]}:
            return None  # The place is unfit, and no object could be carried elsewhere.
        aside = here and bool(situation.held) and situation.held.isdisjoint(action.arguments)
        names = [name for name, _ in action.schema.parameters]
        known = dict(zip(names, action.arguments, strict=True))
        far = len(unmet) > 1 and not self._leads_on(action.schema, known)
        taken = self._is_taken(action, unmet, meant)
        return _Rank(not taken, len(never), vain, aside, far, -len(action.arguments), len(unmet))

    def _is_taken(self, action: GroundAction, unmet: tuple[Unmet, ...], meant: list[str]) -> bool:
        """Return whether an action walks to the meant station, which another player blocks."""
        stations = {self._occupancy.needed_free(each) for each in unmet}
        walks = action.destination is not None
        return walks and stations == {*meant[:1]}

    def _is_for_ever(self, unmet: Unmet) -> bool:
        """Return whether no action can ever change an unmet condition."""
        if unmet.predicate in self._world.table.static_predicates:
            return True
        needed = bool(unmet.predicate) and unmet.expected
        return needed and not self._preparation.can_become(unmet.predicate, unmet.objects)

    def _is_nowhere(self, unmet: Unmet) -> bool:
        """Return whether a fixed condition holds for nothing in this task."""
        if unmet.predicate not in self._world.table.static_predicates:
            return False
        return all(atom[0] != unmet.predicate for atom in self._world.table.static)

    # Actions with something that does not exist yet

    def _unmade(
        self, situation: Situation, bindings: list[InputBinding], meant: list[str], near: list[str]
    ) -> Iterator[tuple[_Rank, str]]:
        """Yield actions towards the goal that lack an object, with the work that makes it."""
        for binding in bindings:
            for arguments in self._arguments(binding, situation.me, meant, near):
                if arguments.count(None) == 1:
                    names = [name for name, _ in binding.schema.parameters]
                    known = dict(zip(names, arguments, strict=True))
                    rank = self._rank_of_unmade(situation, binding.schema, known, meant)
                    if rank is None:
                        continue
                    if words := self._before(situation.state, binding.schema, known):
                        yield rank, words

    def _rank_of_unmade(
        self,
        situation: Situation,
        schema: ActionSchema,
        known: Mapping[str, str | None],
        meant: list[str],
    ) -> _Rank | None:
        """Return the rank of an action that lacks one object, as `_rank` does."""
        table, facts, missing = self._world.table, situation.state.facts, 0
        for condition in schema.definition.precons:
            names = [known[each] for each in condition.params]
            if None in names:
                continue
            atom = (condition.predicate, *(name for name in names if name is not None))
            if table.holds(atom, facts) != condition.is_true:
                missing += 1
                if condition.predicate in table.static_predicates:
                    return None
        if missing > _MAX_UNMET or not self._leads_on(schema, known):
            return None
        things = {name for name in known.values() if name is not None}
        aside = (
            meant[:1] == [situation.at]
            and bool(situation.held)
            and situation.held.isdisjoint(things)
        )
        return _Rank(True, 0, False, aside, False, -len(known), missing + 1)

    def _before(self, state: State, schema: ActionSchema, known: Mapping[str, str | None]) -> str:
        """Return the work that makes the missing object, in words."""
        for condition in schema.definition.precons:
            names = [known[each] for each in condition.params]
            if condition.is_true and None in names and len(names) > 1:
                work = self._preparation.work_for(condition.predicate, names)
                if work is not None:
                    return self._words.first(work, state)
        return ""

    def serves_goal(self, action: GroundAction, station: str | None = None) -> bool:
        """Return whether an action achieves a goal term, which must be about any given station."""
        return self._leads_on(action.schema, action.schema.bind(action.arguments), station)

    def _leads_on(
        self, schema: ActionSchema, known: Mapping[str, str | None], about: str | None = None
    ) -> bool:
        """Return whether an action achieves a goal term for objects of these kinds.

        A missing object, None in `known`, may be of any kind.

        Args:
            about: Object that the term must be about.
        """
        kinds = {n: None if name is None else self._world.thing(name).kind
                 for n, name in known.items()}  # fmt: skip
        return any(
            term.predicate == fact.predicate
            and all(
                kinds[n] in (None, kind) for n, kind in zip(fact.params, term.args, strict=True)
            )
            for fact in schema.definition.immediate_fx
            if fact.is_true and (about is None or about in map(known.get, fact.params))
            for term in self._world.goal.terms
        )

    # Objects that actions may be about

    def _arguments(
        self, binding: InputBinding, me: str, meant: list[str], near: list[str]
    ) -> Iterator[tuple[str | None, ...]]:
        """Yield ways to fill an action's parameters with objects nearby.

        None stands for an object that is not nearby and can be made.
        """
        choices: list[Iterable[str | None]] = []
        for index, (name, kind) in enumerate(binding.schema.parameters):
            if index == 0 and binding.schema.player:
                choices.append((me,))
                continue
            pool = meant if name == binding.parameter else near
            fitting = [n for n in pool if self._world.thing(n).type == kind]
            choices.append(fitting or ([None] if self._preparation.creates(kind) else []))
        for arguments in itertools.islice(itertools.product(*choices), _MAX_ATTEMPTS):
            if len(set(arguments)) == len(arguments):
                yield arguments


def things_upon(target: str, placed: dict[str, Placed]) -> list[str]:
    """Return what lies on or is in an object, the uppermost first."""
    upon = [p for p in placed.values() if p.host == target]
    upon.sort(key=lambda p: -p.level)
    found = []
    for thing in upon:
        found += [thing.thing.name, *things_upon(thing.thing.name, placed)]
    return found


def _near(me: str, meant: list[str], placed: dict[str, Placed]) -> list[str]:
    """Return the player's station and hands, with everything that lies there or is held."""
    here = placed[me].at if me in placed else None
    hosts = dict.fromkeys([*([here] if here else []), *meant[:1], me])
    found: dict[str, None] = {}
    for host in hosts:
        found.update(dict.fromkeys([host, *things_upon(host, placed)]))
    return list(found)
