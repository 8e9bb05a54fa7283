"""Objects, actions and reasons in plain words, from a domain's language.

For anything the language does not name, the domain's sentences and kind names are used.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from types import MappingProxyType

from robotouille.domain.rendering import Language
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.presentation.places import filled, parameters, places
from robotouille.world.presentation.work import Occupancy, Work, preparation_of
from robotouille.world.scene import Placed, scene
from robotouille.world.text import describe
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World

MAX_KINDS = 3
"""Most kinds that a reason lists."""

SOMEBODY, SOMETHING, SOMEWHERE = "somebody", "something", "some place"


class Wording:
    """Words for one reader in one world.

    Args:
        me: Player of the reader, called `you`.
        names: Names of the participants by player.
    """

    def __init__(
        self,
        world: World,
        language: Language,
        me: str | None = None,
        names: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self.world = world
        self.language = language
        self.me = me
        self.names = names
        self.preparation = preparation_of(world)
        self._occupancy = Occupancy(world)
        self._lately: tuple[State, dict[str, str]] | None = None

    # Things

    def kind(self, kind: str) -> str:
        """Return the name of a kind, whatever its state."""
        found = [each.name for each in self.language.kinds.get(kind, ()) if each.when is None]
        return found[0] if found else kind.replace("_", " ")

    def thing(self, name: str, state: State) -> str:
        """Return the name of an object, such as `the pot`."""
        if name == self.me:
            return "you"
        if name in self.names:
            return self.names[name]
        noun = self._noun(name, state)
        number = _number(name) if name in self.world.players else ""
        return f"{noun} {number}" if number else f"the {noun}"

    def place(self, station: str, state: State) -> str:
        """Return a station's unique name, such as `the left table at the top`."""
        return self.places(state).get(station) or self.thing(station, state)

    def places(self, state: State) -> dict[str, str]:
        """Return the names of all stations by object name; all differ."""
        # All names of a state are needed together, and several times in one frame.
        if self._lately is None or self._lately[0] is not state:
            self._lately = state, self._places(state)
        return self._lately[1]

    def _places(self, state: State) -> dict[str, str]:
        """Name each station by its noun, else by what lies on it, else by its place."""
        nouns = {name: self._noun(name, state) for name in self.world.floor.stations}
        alike, laid = Counter(nouns.values()), self._laid(nouns, state)
        told = Counter(laid.values())
        return {
            name: f"the {noun}"
            if alike[noun] == 1
            else laid[name] if told[laid.get(name, "")] == 1 else self._sides[name]
            for name, noun in nouns.items()
        }  # fmt: skip

    def _laid(self, nouns: Mapping[str, str], state: State) -> dict[str, str]:
        """Name stations by the dish on them, or by the lowest object."""
        stacks: dict[str, list[Placed]] = {}
        for each in sorted(scene(state).values(), key=lambda placed: placed.level):
            if each.host in nouns:
                stacks.setdefault(each.host or "", []).append(each)
        template = self.language.places.with_things
        return {
            name: filled(template, noun=nouns[name], things=self._stack(stack, state))
            for name, stack in stacks.items()
            if stack[0].level == 0
        }

    def _stack(self, stack: Sequence[Placed], state: State) -> str:
        """Name a stack from the bottom up, such as `the burger` or `the cut tomato`."""
        bottom, top = stack[0].thing, stack[-1].thing
        # A pile of one kind is a supply, not a dish.
        mixed = any(each.thing.kind != bottom.kind for each in stack)
        for dish in self.language.dishes if mixed else ():
            if dish.bottom == bottom.kind:
                done = dish.top == top.kind and len(stack) > 2
                return f"the {(dish.name if done else dish.begun) or dish.name}"
        return self.thing(bottom.name, state)

    @cached_property
    def _sides(self) -> dict[str, str]:
        nouns = {n: self.kind(self.world.thing(n).kind) for n in self.world.floor.stations}
        return places(self.world.floor, nouns, self.language.places)

    def things(self, names: Iterable[str], state: State) -> dict[str, str]:
        """Return the names of several objects in one sentence, with equal names told apart."""
        names = tuple(dict.fromkeys(names))
        called = {name: self.thing(name, state) for name in names}
        sounds = Counter(called.values())
        heard: Counter[str] = Counter()
        for name, sound in called.items():
            if sounds[sound] > 1:
                called[name] = self._apart(name, state, heard[sound], sounds[sound])
                heard[sound] += 1
        return called

    def _apart(self, name: str, state: State, before: int, alike: int) -> str:
        """Return the name of one of several objects with the same name."""
        if name in self.places(state):
            return self.place(name, state)
        noun = self._noun(name, state)
        if alike == 2:
            return filled(self.language.other, noun=noun) if before else f"the {noun}"
        return f"{noun} {_number(name)}".strip()

    def _noun(self, name: str, state: State) -> str:
        kind = self.world.thing(name).kind
        for each in self.language.kinds.get(kind, ()):
            if each.when is None or _any_fact(state, each.when, name):
                return self._in_state(each.name, name, state)
        return self._in_state(kind.replace("_", " "), name, state)

    def _in_state(self, noun: str, name: str, state: State) -> str:
        """Put the words for an object's state before its noun, such as `cut tomato`."""
        placed = scene(state).get(name) if self.language.states else None
        facts = placed.facts if placed is not None else ()
        return " ".join(
            [*(word for fact, word in self.language.states.items() if fact in facts), noun]
        )

    def purposes(self) -> tuple[tuple[str, str], ...]:
        """Return the name of each kind of station that has words for its purpose, with these."""
        kinds = dict.fromkeys(self.world.thing(name).kind for name in self.world.floor.stations)
        # The words of an extending file come last, and are about what is special in its kitchens.
        told = reversed(self.language.purposes.items())
        return tuple((self.kind(kind), words) for kind, words in told if kind in kinds)

    def purpose(self, kind: str) -> str:
        """Return what a kind of station is for; empty if there are no words for it."""
        return self.language.purposes.get(kind, "")

    # Actions

    def action(self, action: GroundAction, state: State) -> str:
        """Return an action in words, such as `cut the lettuce`."""
        words = self.language.actions.get(action.name)
        template = words.do if words else ""
        if words and words.alike and self._is_about_alike(action):
            template = words.alike
        told = self._filled(template, action, state)
        return told or _lower(self._filled(_without_player(action), action, state))

    def _is_about_alike(self, action: GroundAction) -> bool:
        """Return whether two objects of an action are of one kind."""
        kinds = [self.world.thing(name).kind for name in action.arguments]
        return len({*kinds}) < len(kinds)

    def in_general(self, schema: ActionSchema) -> str:
        """Return an action without its objects, such as `cut something`."""
        words = self.language.actions.get(schema.name)
        template = words.do if words else ""
        stations = {self.world.thing(name).type for name in self.world.floor.stations}
        whatever = {n: SOMEWHERE if t in stations else SOMETHING for n, t in schema.parameters}
        return filled(template, **whatever) or schema.name.replace("-", " ")

    def here(self, schemas: Iterable[ActionSchema]) -> str:
        """Return what a place is for, given the actions possible there."""
        words = self.language.work
        does = dict.fromkeys(map(self.in_general, schemas))
        return filled(words.here, actions=words.either.join(does)) if does else ""

    def first(self, work: Work, state: State) -> str:
        """Return work that has to come first, such as `fill the pot with water first, at the sink`.

        If the work is already going on, say to wait for it.
        """
        words, schema = self.language.work, work.schema
        if self.preparation.is_under_way(state, work):
            return words.under_way
        known = self.language.actions.get(schema.name)
        template = known.do if known else ""
        called = self.things(work.binding.values(), state)
        named = {name: called[thing] for name, thing in work.binding.items()}
        rest = {name: SOMETHING for name in parameters(template) if name not in named}
        does = filled(template, **named, **rest) or schema.name.replace("-", " ")
        place = self._where(work.places, state)
        template = words.first_at if place else words.first
        return filled(template, action=does, place=place)

    def _where(self, stations: Sequence[str], state: State) -> str:
        """Name one of several stations, such as `a stove`; empty if they are of several kinds."""
        kinds = {self.world.thing(name).kind for name in stations}
        if len(kinds) != 1:
            return ""
        if len(stations) == 1:
            return self.place(stations[0], state)
        return _with_article(self.kind(kinds.pop()))

    def way(self, action: GroundAction, unmet: Collection[Unmet], state: State) -> str:
        """Return what to do to make an action possible."""
        told = self._how(action, unmet, state)
        return told or "; ".join(dict.fromkeys(self.reason(each, state) for each in unmet))

    def rejection(self, sentence: str, player: str, unmet: Sequence[Unmet], state: State) -> str:
        """Return why a player's action was rejected, or how to make it possible.

        Args:
            sentence: The action, as `World.parse` reads it.
            player: The player of the action.
        """
        with suppress(RobotouilleError):
            action = self.world.parse(state, player, sentence, valid=False)
            if told := self._how(action, unmet, state):
                return told
        return self.reason(unmet[0], state) if unmet else ""

    def _how(self, action: GroundAction, unmet: Collection[Unmet], state: State) -> str:
        """Return the language's own advice for an action with several unmet conditions."""
        words = self.language.actions.get(action.name)
        return self._filled(words.how, action, state) if words and len(unmet) > 1 else ""

    def _filled(self, template: str, action: GroundAction, state: State) -> str:
        named = parameters(template)
        binding = action.schema.bind(action.arguments)
        things = {name: thing for name, thing in binding.items() if name in named}
        called = self.things(things.values(), state)
        travel = action.schema.definition.travel
        if travel and travel[1] in things:
            called[things[travel[1]]] = self.place(things[travel[1]], state)
        return filled(template, **{name: called[thing] for name, thing in things.items()})

    # Reasons

    def reason(self, unmet: Unmet, state: State) -> str:
        """Return what is missing for an action, in its way, or to be done first."""
        if unmet.kind is UnmetKind.CONDITION and self._is_fact(unmet):
            return self._condition(unmet, state)
        if unmet.kind is UnmetKind.MISSING and unmet.objects:
            return f"{self._known(unmet.objects, state)[0]} is not there"
        if unmet.kind is UnmetKind.BUSY and unmet.objects:
            who = self._known(unmet.objects, state)[0]
            return f"{who} {'are' if who == 'you' else 'is'} still busy"
        if unmet.kind is UnmetKind.TURN and unmet.objects:
            return f"it is {self._known(unmet.objects, state)[0]}'s turn"
        return unmet.words

    def _is_fact(self, unmet: Unmet) -> bool:
        """Return whether a condition is one of the domain. A faulty server may send any other."""
        types = self.world.table.types.get(unmet.predicate)
        return types is not None and len(types) == len(unmet.objects)

    def _condition(self, unmet: Unmet, state: State) -> str:
        called = self._known(unmet.objects, state, predicate=unmet.predicate)
        words = self.language.predicates.get(unmet.predicate)
        template = (words.needed if unmet.expected else words.forbidden) if words else ""
        who = self._standing(unmet, state)
        # Advice helps more than naming the missing fact.
        if unmet.expected and (work := self._work(unmet)) is not None:
            return self.first(work, state)
        if told := filled(template, *called, who=who or SOMEBODY):
            return told
        if unmet.expected and len(called) == 1 and (kinds := self._kinds(unmet.predicate)):
            return f"needs {' or '.join(kinds)}, which {called[0]} is not"
        named = self._known(unmet.objects, state, you=False)
        fact = describe(self.world.task.domain, (unmet.predicate, *named))
        return f"needs: {fact}" if unmet.expected else f"not while {fact}"

    def _work(self, unmet: Unmet) -> Work | None:
        """Return the work that makes a condition true."""
        known = all(name in self.world.thing_names for name in unmet.objects)
        return self.preparation.work_for(unmet.predicate, unmet.objects) if known else None

    def _standing(self, unmet: Unmet, state: State) -> str:
        """Return who stands where nobody may, if the condition is about that."""
        station = self._occupancy.needed_free(unmet)
        if station is None:
            return ""
        others = self._occupancy.players_at(state, station)
        return next((self.thing(p, state) for p in others if p != self.me), "")

    def _known(
        self, objects: tuple[str, ...], state: State, *, predicate: str = "", you: bool = True
    ) -> list[str]:
        """Return the names of objects; unknown objects keep their identifiers.

        Args:
            predicate: Predicate of the condition. If it is about standing, stations get unique
                names.
            you: If false, the reader's player gets its noun, as a domain's sentences need.
        """
        called = self.things((n for n in objects if n in self.world.thing_names), state)
        if predicate and self._occupancy.is_about_standing(predicate):
            places = self.places(state)
            called |= {name: places[name] for name in called if name in places}
        if not you and self.me in called:
            called[self.me] = f"the {self._noun(self.me, state)}"
        return [called.get(name, name) for name in objects]

    def _kinds(self, predicate: str) -> list[str]:
        """Return the kinds for which a static predicate holds, if there are few: `a board`."""
        static = self.world.table.static
        holding = sorted({a[1] for a in static if a[0] == predicate and len(a) == 2})
        kinds = dict.fromkeys(self.kind(self.world.thing(name).kind) for name in holding)
        return [_with_article(kind) for kind in kinds] if len(kinds) <= MAX_KINDS else []


def _any_fact(state: State, predicate: str, name: str) -> bool:
    return any(atom[0] == predicate and name in atom[1:] for atom in state.atoms())


def _number(name: str) -> str:
    found = re.search(r"\d+$", name)
    return found[0] if found else ""


def _with_article(noun: str) -> str:
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def _lower(words: str) -> str:
    return words[:1].lower() + words[1:]


def _without_player(action: GroundAction) -> str:
    """Return the domain's sentence without `… with {p1}`, or else without `{p1}`."""
    template = action.schema.definition.language_description
    if not action.schema.player:
        return template
    player, _ = action.schema.parameters[0]
    shorter = re.sub(rf"\s+\w+\s+\{{{player}\}}\s*$", "", template)
    return shorter if shorter != template else template.replace(f" {{{player}}}", "", 1)
