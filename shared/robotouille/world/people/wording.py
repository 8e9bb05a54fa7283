"""Things, actions and reasons in the words of a person, by a domain's language.

What the language does not name is said by the sentences of the domain, and by the names of its
kinds: readable, if not as nice.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from string import Formatter
from types import MappingProxyType

from robotouille.domain.rendering import Language
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.text import describe
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World

__all__ = ["Wording"]

MAX_KINDS = 3
"""Kinds that are listed as what is needed."""


class Wording:
    """The words of one person in one world.

    Args:
        me: The player whose owner reads this: `you`.
        names: What the participants are called, by player.
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
        self._numbers = Counter(thing.kind for thing in world.placed)

    # Things

    def kind(self, kind: str) -> str:
        """What things of a kind are called, whatever holds of them."""
        found = [each.name for each in self.language.kinds.get(kind, ()) if each.when is None]
        return found[0] if found else kind.replace("_", " ")

    def thing(self, name: str, state: State, *, numbered: bool = False) -> str:
        """What one thing is called: `the pot`; `numbered` where there are others: `table 2`."""
        if name == self.me:
            return "you"
        if name in self.names:
            return self.names[name]
        noun, number = self._noun(name, state), _number(name)
        shared = numbered or name in self.world.players
        return f"{noun} {number}" if shared and number else f"the {noun}"

    def place(self, station: str, state: State) -> str:
        """What a station is called by somebody who stands elsewhere: numbered if there are more."""
        several = self._numbers[self.world.thing(station).kind] > 1
        return self.thing(station, state, numbered=several)

    def things(self, names: Iterable[str], state: State) -> dict[str, str]:
        """What some things are called in one sentence: numbered only where two sound alike."""
        names = tuple(dict.fromkeys(names))
        sounds = Counter(self.thing(name, state) for name in names)
        return {n: self.thing(n, state, numbered=sounds[self.thing(n, state)] > 1) for n in names}

    def _noun(self, name: str, state: State) -> str:
        kind = self.world.thing(name).kind
        for each in self.language.kinds.get(kind, ()):
            if each.when is None or _any_fact(state, each.when, name):
                return each.name
        return kind.replace("_", " ")

    # Actions

    def action(self, action: GroundAction, state: State) -> str:
        """What an action does: `cut the lettuce`."""
        words = self.language.actions.get(action.name)
        told = self._filled(words.do, action, state) if words else ""
        return told or _lower(self._filled(_without_player(action), action, state))

    def way(self, action: GroundAction, unmet: Collection[Unmet], state: State) -> str:
        """What to do so that an action becomes possible."""
        words = self.language.actions.get(action.name)
        told = self._filled(words.how, action, state) if words and len(unmet) > 1 else ""
        return told or "; ".join(dict.fromkeys(self.reason(each, state) for each in unmet))

    def _filled(self, template: str, action: GroundAction, state: State) -> str:
        named = _parameters(template)
        binding = action.schema.bind(action.arguments)
        things = {name: thing for name, thing in binding.items() if name in named}
        called = self.things(things.values(), state)
        words = {name: called[thing] for name, thing in things.items()}
        return _filled(template, **words)

    # Reasons

    def reason(self, unmet: Unmet, state: State) -> str:
        """Why something cannot be done, as what is missing or in the way."""
        if unmet.kind is UnmetKind.CONDITION and unmet.predicate:
            return self._condition(unmet, state)
        if unmet.kind is UnmetKind.MISSING and unmet.objects:
            return f"{self._known(unmet.objects, state)[0]} is not there"
        if unmet.kind is UnmetKind.BUSY and unmet.objects:
            who = self._known(unmet.objects, state)[0]
            return f"{who} {'are' if who == 'you' else 'is'} still busy"
        if unmet.kind is UnmetKind.TURN and unmet.objects:
            return f"it is {self._known(unmet.objects, state)[0]}'s turn"
        return unmet.words

    def _condition(self, unmet: Unmet, state: State) -> str:
        called = self._known(unmet.objects, state)
        words = self.language.predicates.get(unmet.predicate)
        template = (words.needed if unmet.expected else words.forbidden) if words else ""
        if told := _filled(template, *called):
            return told
        if unmet.expected and len(called) == 1 and (kinds := self._kinds(unmet.predicate)):
            return f"needs {' or '.join(kinds)}, which {called[0]} is not"
        named = self._known(unmet.objects, state, you=False)
        fact = describe(self.world.task.domain, (unmet.predicate, *named))
        return f"needs: {fact}" if unmet.expected else f"not while {fact}"

    def _known(self, objects: tuple[str, ...], state: State, *, you: bool = True) -> list[str]:
        """What some objects are called; one that is not known keeps its name. Without `you` that
        player is called like others, as a domain speaks of it."""
        called = self.things((n for n in objects if n in self.world.thing_names), state)
        if not you and self.me in called:
            called[self.me] = f"the {self._noun(self.me, state)}"
        return [called.get(name, name) for name in objects]

    def _kinds(self, predicate: str) -> list[str]:
        """The kinds of which a predicate holds for ever, if they are few: `a board`."""
        static = self.world.table.static
        holding = sorted({a[1] for a in static if a[0] == predicate and len(a) == 2})
        kinds = dict.fromkeys(self.kind(self.world.thing(name).kind) for name in holding)
        return [_with_article(kind) for kind in kinds] if len(kinds) <= MAX_KINDS else []


def _filled(template: str, *called: str, **words: str) -> str:
    """A template with its words; empty where it asks for others than there are."""
    try:
        return template.format(*called, **words)
    except (LookupError, ValueError):
        return ""


def _parameters(template: str) -> set[str]:
    """What a template asks for; nothing where it is none."""
    try:
        return {name for _, name, _, _ in Formatter().parse(template) if name}
    except ValueError:
        return set()


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
    """The domain's sentence without who does it: `… with {p1}` at its end, or `{p1}` alone."""
    template = action.schema.definition.language_description
    if not action.schema.player:
        return template
    player, _ = action.schema.parameters[0]
    shorter = re.sub(rf"\s+\w+\s+\{{{player}\}}\s*$", "", template)
    return shorter if shorter != template else template.replace(f" {{{player}}}", "", 1)
