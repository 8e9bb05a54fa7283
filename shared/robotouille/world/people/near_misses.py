"""What an input nearly means: the action that lacks the least, and what to do for it first.

Pure: names of objects in, words out. What an input may mean is for whoever reads it to say.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.people.occupancy import Occupancy
from robotouille.world.people.templates import capitalised
from robotouille.world.people.usefulness import changes_something, work_in_progress
from robotouille.world.people.wording import Wording
from robotouille.world.scene import Placed
from robotouille.world.unmet import Unmet
from robotouille.world.world import State, World

__all__ = ["InputBinding", "NearMiss", "NearMisses", "Situation", "things_upon"]

_MAX_ATTEMPTS = 2000
_MAX_UNMET = 2


class _Rank(NamedTuple):
    """How far from being possible an action is; the least comes first.

    A walk to where somebody stands comes before what one `acts` there. Last are, the worst first:
    what `never` can be done at this place, what is in `vain` as it would change nothing, what has
    to do with nothing that one holds (`aside`), what lacks several things and is nothing that the
    goal asks for (`far`). Of others, what is about more of what is here (`about`, less than 0)
    comes first, then what lacks less.
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
    """An action and the parameter that the input decides (None: none)."""

    schema: ActionSchema
    parameter: str | None


class Situation:
    """A state as one player sees it: where it stands, and what it holds."""

    def __init__(self, state: State, me: str, placed: dict[str, Placed]) -> None:
        self.state = state
        self.me = me
        self.placed = placed
        self.at = placed[me].at if me in placed else None
        self.held = frozenset(things_upon(me, placed))


@dataclass(frozen=True, slots=True)
class NearMiss:
    """What to tell about an input that can do nothing now; `action` is what it would be, None where
    that cannot even be tried. With `advice` it says what to do."""

    action: GroundAction | None
    words: str
    advice: bool = True


class NearMisses:
    """Finds the nearest miss of a player's input.

    Args:
        wording: Of the player.
    """

    def __init__(self, world: World, wording: Wording) -> None:
        self._world = world
        self._words = wording
        self._preparation = wording.preparation
        self._occupancy = Occupancy(world)

    def nearest(
        self, situation: Situation, bindings: list[InputBinding], meant: list[str], *, at_work: bool
    ) -> NearMiss:
        """The action that is nearest to being possible, or the work that comes before it.

        Args:
            meant: What the input may be about, the most likely first.
            at_work: Something is at work here, which no other work is to follow.
        """
        near = _near(situation.me, meant, situation.placed)
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
        """What a place is for on which nothing is; else that there is nothing to do."""
        if any(row.running and row.subject in meant for row in work_in_progress(situation.state)):
            return NearMiss(None, self._words.language.work.under_way)
        there = [name for name in meant[:1] if name != situation.me]
        if len(meant) == 1 and not situation.held and meant[0] == situation.at:
            schemas = [each.schema for each in bindings if self._is_for(each, meant[0])]
            if words := self._words.here(schemas):
                return NearMiss(None, capitalised(words))
        where = self._words.thing(there[0], situation.state) if there else ""
        words = f"nothing to do at {where}" if where else "nothing to do here"
        return NearMiss(None, words, advice=False)

    def _is_for(self, binding: InputBinding, station: str) -> bool:
        """Whether an action needs a station such as this one, and something on it that there is."""
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
        """Of an action that can be tried; None for one that is not worth telling."""
        never = [each for each in unmet if self._is_for_ever(each)]
        vain = not changes_something(situation.state, action)
        if not 0 < len(unmet) <= _MAX_UNMET or len(never) > 1:
            return None
        if (vain and all(each.expected for each in unmet)) or any(map(self._is_nowhere, never)):
            return None
        here = meant[:1] == [situation.at]
        if never and here and {*action.arguments} <= {situation.me, *meant[:1]}:
            return None  # A place that is not for it, and nothing that could go elsewhere.
        aside = here and bool(situation.held) and situation.held.isdisjoint(action.arguments)
        names = [name for name, _ in action.schema.parameters]
        known = dict(zip(names, action.arguments, strict=True))
        far = len(unmet) > 1 and not self._leads_on(action.schema, known)
        taken = self._is_taken(action, unmet, meant)
        return _Rank(not taken, len(never), vain, aside, far, -len(action.arguments), len(unmet))

    def _is_taken(self, action: GroundAction, unmet: tuple[Unmet, ...], meant: list[str]) -> bool:
        """Whether an action walks to what is meant, and only somebody who stands there hinders."""
        stations = {self._occupancy.needed_free(each) for each in unmet}
        walks = action.destination is not None
        return walks and stations == {*meant[:1]}

    def _is_for_ever(self, unmet: Unmet) -> bool:
        """Whether nothing that anybody does will ever make a difference to it."""
        if unmet.predicate in self._world.table.static_predicates:
            return True
        needed = bool(unmet.predicate) and unmet.expected
        return needed and not self._preparation.can_become(unmet.predicate, unmet.objects)

    def _is_nowhere(self, unmet: Unmet) -> bool:
        """Whether what is needed for good holds of nothing there is in this task."""
        if unmet.predicate not in self._world.table.static_predicates:
            return False
        return all(atom[0] != unmet.predicate for atom in self._world.table.static)

    # Actions with something that does not exist yet

    def _unmade(
        self, situation: Situation, bindings: list[InputBinding], meant: list[str], near: list[str]
    ) -> Iterator[tuple[_Rank, str]]:
        """Actions that lead to the goal and lack a thing that has to be made first, with how."""
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
        """As `_rank` has it, of an action of which one thing is not there."""
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
        """The work that makes what is not there."""
        for condition in schema.definition.precons:
            names = [known[each] for each in condition.params]
            if condition.is_true and None in names and len(names) > 1:
                work = self._preparation.work_for(condition.predicate, names)
                if work is not None:
                    return self._words.first(work, state)
        return ""

    def _leads_on(self, schema: ActionSchema, known: Mapping[str, str | None]) -> bool:
        """Whether an action does something that the goal asks for: of things of these kinds; what
        is not there may be of any."""
        kinds = {n: None if name is None else self._world.thing(name).kind
                 for n, name in known.items()}  # fmt: skip
        return any(
            term.predicate == fact.predicate
            and all(
                kinds[n] in (None, kind) for n, kind in zip(fact.params, term.args, strict=True)
            )
            for fact in schema.definition.immediate_fx
            if fact.is_true
            for term in self._world.goal.terms
        )

    # What they may be about

    def _arguments(
        self, binding: InputBinding, me: str, meant: list[str], near: list[str]
    ) -> Iterator[tuple[str | None, ...]]:
        """Ways to fill the parameters of an action with what is near; None is something of which
        there is nothing near, and which can be made."""
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
    """What lies on or is in an object, the uppermost first."""
    upon = [p for p in placed.values() if p.host == target]
    upon.sort(key=lambda p: -p.level)
    found = []
    for thing in upon:
        found += [thing.thing.name, *things_upon(thing.thing.name, placed)]
    return found


def _near(me: str, meant: list[str], placed: dict[str, Placed]) -> list[str]:
    """What an action of a player may be about: its station, and what lies there or is held."""
    here = placed[me].at if me in placed else None
    hosts = dict.fromkeys([*([here] if here else []), *meant[:1], me])
    found: dict[str, None] = {}
    for host in hosts:
        found.update(dict.fromkeys([host, *things_upon(host, placed)]))
    return list(found)
