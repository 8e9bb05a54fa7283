"""What a click or a key means: the ground action of a domain's input file.

Pure: names of objects, buttons and keys in, an action out. The window finds out which object is
under the mouse.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.rendering import Language, language_of
from robotouille.domain.schema import InputFile
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.people.occupancy import Occupancy
from robotouille.world.people.usefulness import changes_something, useful_actions, work_in_progress
from robotouille.world.people.wording import Wording
from robotouille.world.scene import Placed, scene
from robotouille.world.unmet import Unmet
from robotouille.world.world import State, World

__all__ = ["Button", "Controls", "Meaning", "Option"]

Button = Literal["left", "middle", "right"]

_MAX_ATTEMPTS = 2000
_NEAR_MISS = 2


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a click or key would do: an action, which is `valid` or will be rejected, or none.

    `hint` says it in words; where there is no action, why.
    """

    action: GroundAction | None
    hint: str
    valid: bool = False


@dataclass(frozen=True, slots=True)
class Option:
    """A key and what pressing it would do now."""

    key: str
    action: GroundAction


@dataclass(frozen=True, slots=True)
class _KeyBinding:
    """An action and the parameter that the input decides (None: none)."""

    schema: ActionSchema
    parameter: str | None


class Controls:
    """Reads the mouse and the keyboard of one player's owner.

    What a click or a key means by itself comes first. Where that is nothing which can be done and
    changes something, a click on the place where one stands means what a key would do there, and a
    key what a click would. `names` are what participants are called, by player.
    """

    def __init__(
        self, world: World, bindings: InputFile | None = None, language: Language | None = None
    ) -> None:
        self.world = world
        self.names: Mapping[str, str] = MappingProxyType({})
        self.bindings = bindings or bindings_of(world.task)
        self.language = language_of(world.task) if language is None else language
        self._occupancy = Occupancy(world)
        schemas = {schema.name: schema for schema in world.schemas}
        self._clicks: dict[str, list[_KeyBinding]] = {}
        self._keys: dict[str, list[_KeyBinding]] = {}
        for click in self.bindings.mouse_click_actions:
            how = click.input_instructions
            if click.name in schemas:
                binding = _KeyBinding(schemas[click.name], how.click_on)
                self._clicks.setdefault(how.button, []).append(binding)
        for key in self.bindings.keyboard_actions:
            if key.name in schemas:
                binding = _KeyBinding(schemas[key.name], key.input_instructions.at)
                name = key.input_instructions.key.casefold()
                self._keys.setdefault(name, []).append(binding)

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that mean something, in the input file's order."""
        return tuple(self._keys)

    def is_for_places(self, key: str) -> bool:
        """Whether what a key means depends on where one stands."""
        return any(binding.parameter for binding in self._keys.get(key, ()))

    def wording(self, me: str | None) -> Wording:
        """The words for who plays `me`."""
        others = {player: name for player, name in self.names.items() if player != me and name}
        return Wording(self.world, self.language, me, others)

    def click(self, state: State, me: str, target: str, button: Button = "left") -> Meaning:
        """What clicking on an object means; what lies on it can be meant as well."""
        moment = _Moment(state, me, scene(state))
        own = self._clicks.get(button, [])
        others = self._keys_at_a_place() if own and target == moment.at else []
        return self._meaning(moment, own, others, [target, *_upon(target, moment.placed)])

    def key(self, state: State, me: str, key: str) -> Meaning:
        """What a key means where the player is."""
        moment = _Moment(state, me, scene(state))
        own = self._keys.get(key.casefold(), [])
        here = [moment.at, *_upon(moment.at, moment.placed)] if moment.at else []
        at_a_place = any(binding.parameter for binding in own)
        others = self._clicks.get("left", []) if at_a_place and here else []
        return self._meaning(moment, own, others, here)

    def options(self, state: State, me: str) -> tuple[Option, ...]:
        """The keys whose own action is valid now and changes something, but for those that always
        are."""
        moment, found = _Moment(state, me, scene(state)), []
        here = [moment.at] if moment.at else []
        for key, bindings in self._keys.items():
            if all(binding.parameter is None for binding in bindings):
                continue
            action = _useful(moment, bindings, here)
            if action is not None:
                found.append(Option(key, action))
        return tuple(found)

    def help(self) -> tuple[tuple[str, str], ...]:
        """Rows of (input, what it does): of the input file, then those that are made up."""
        rows = []
        for button, bindings in self._clicks.items():
            rows.append((f"{button.capitalize()} click", self._names(bindings)))
        for key, bindings in self._keys.items():
            rows.append((key.upper() if len(key) == 1 else key.capitalize(), self._names(bindings)))
        return tuple(rows)

    def _names(self, bindings: list[_KeyBinding]) -> str:
        """What actions do, of whatever it may be."""
        wording = self.wording(None)
        return ", ".join(dict.fromkeys(wording.in_general(each.schema) for each in bindings))

    def _keys_at_a_place(self) -> list[_KeyBinding]:
        return [each for bindings in self._keys.values() for each in bindings if each.parameter]

    def _meaning(
        self,
        moment: _Moment,
        own: list[_KeyBinding],
        others: list[_KeyBinding],
        meant: list[str],
    ) -> Meaning:
        if not own:
            return Meaning(None, "")
        state, me = moment.state, moment.me
        busy = state.busy_steps(me)
        if busy:
            return Meaning(None, f"busy for {busy} more step{'s' * (busy > 1)}")
        action = _useful(moment, own, meant)
        at_work = action is None and _is_at_work(moment, own, meant)
        if action is None and not at_work:
            action = _useful(moment, others, meant)
        if action is not None:
            return Meaning(action, _capital(self.wording(me).action(action, state)), True)
        return self._attempt(moment, [*own, *others], meant, at_work=at_work)

    def _attempt(
        self, moment: _Moment, bindings: list[_KeyBinding], meant: list[str], *, at_work: bool
    ) -> Meaning:
        """The action that is nearest to being possible: its rejection will say what is amiss."""
        near = _near(moment.me, meant, moment.placed)
        nearest: tuple[tuple[int, ...], GroundAction, tuple[Unmet, ...]] | None = None
        for binding in bindings:
            for action in self._candidates(binding, moment.me, meant, near):
                unmet = self.world.unmet(moment.state, action)
                rank = self._rank(moment, action, unmet, meant)
                if rank is None or (at_work and rank[1]):
                    continue
                if nearest is None or rank < nearest[0]:
                    nearest = rank, action, unmet
        words = self.wording(moment.me)
        if nearest is None:
            there = [name for name in meant[:1] if name != moment.me]
            where = words.thing(there[0], moment.state) if there else ""
            return Meaning(None, f"nothing to do at {where}" if where else "nothing to do here")
        rank, action, unmet = nearest
        does = _capital(words.action(action, moment.state))
        way = _capital(words.way(action, unmet, moment.state))
        return Meaning(action, way if not rank[0] else f"{does}? {way}")

    def _rank(
        self, moment: _Moment, action: GroundAction, unmet: tuple[Unmet, ...], meant: list[str]
    ) -> tuple[int, ...] | None:
        """How far from being possible an action is, least first: a walk to where somebody stands
        comes before what would be done there; then what is at the wrong place for good, what would
        change nothing, what has to do with nothing that one holds, what has to do with less of what
        is here, what lacks more. None for one that is not worth telling."""
        never = [each for each in unmet if self._is_for_ever(each)]
        vain = not changes_something(moment.state, action)
        if not 0 < len(unmet) <= _NEAR_MISS or len(never) > 1:
            return None
        if (vain and all(each.expected for each in unmet)) or any(map(self._is_nowhere, never)):
            return None
        here = meant[:1] == [moment.at]
        aside = here and bool(moment.held) and moment.held.isdisjoint(action.arguments)
        taken = self._is_taken(action, unmet, meant)
        return not taken, len(never), vain, aside, -len(action.arguments), len(unmet)

    def _is_taken(self, action: GroundAction, unmet: tuple[Unmet, ...], meant: list[str]) -> bool:
        """Whether an action walks to what is meant, and only somebody who stands there hinders."""
        stations = {self._occupancy.needed_free(each) for each in unmet}
        walks = action.schema.definition.travel is not None
        return walks and stations == {*meant[:1]}

    def _is_for_ever(self, unmet: Unmet) -> bool:
        """Whether nothing that anybody does will ever make a difference to it."""
        return unmet.predicate in self.world.table.static_predicates

    def _is_nowhere(self, unmet: Unmet) -> bool:
        """Whether what is needed for good holds of nothing there is in this task."""
        return all(atom[0] != unmet.predicate for atom in self.world.table.static)

    def _candidates(
        self, binding: _KeyBinding, me: str, meant: list[str], near: list[str]
    ) -> Iterator[GroundAction]:
        """Ways to fill the parameters of an action with what is near."""
        choices: list[Iterable[str]] = []
        for index, (name, kind) in enumerate(binding.schema.parameters):
            if index == 0 and binding.schema.player:
                choices.append((me,))
                continue
            pool = meant if name == binding.parameter else near
            choices.append([n for n in pool if self.world.thing(n).type == kind])
        for arguments in itertools.islice(itertools.product(*choices), _MAX_ATTEMPTS):
            if len(set(arguments)) == len(arguments):
                yield self.world.action(binding.schema.name, *arguments)


class _Moment:
    """A state as one player sees it: where it stands, and what it holds."""

    def __init__(self, state: State, me: str, placed: dict[str, Placed]) -> None:
        self.state = state
        self.me = me
        self.placed = placed
        self.at = placed[me].at if me in placed else None
        self.held = frozenset(_upon(me, placed))


def _useful(moment: _Moment, bindings: list[_KeyBinding], meant: list[str]) -> GroundAction | None:
    """The first action of some bindings that is valid and changes something."""
    valid = useful_actions(moment.state, moment.me) if bindings else ()
    for binding in bindings:
        for action in valid:
            if action.schema is binding.schema and _fits(action, binding, meant):
                return action
    return None


def _is_at_work(moment: _Moment, bindings: list[_KeyBinding], meant: list[str]) -> bool:
    """Whether what some bindings do here is going on or done: an input that comes once too often
    is then not taken for another."""
    if any(row.subject in meant for row in work_in_progress(moment.state)):
        return True
    valid = moment.state.actions(moment.me)
    return any(a.schema is b.schema and _fits(a, b, meant) for b in bindings for a in valid)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _fits(action: GroundAction, binding: _KeyBinding, meant: list[str]) -> bool:
    if binding.parameter is None:
        return True
    return action.schema.bind(action.arguments).get(binding.parameter) in meant


def _upon(target: str, placed: dict[str, Placed]) -> list[str]:
    """What lies on or is in an object, the uppermost first."""
    upon = [p for p in placed.values() if p.host == target]
    upon.sort(key=lambda p: -p.level)
    found = []
    for thing in upon:
        found += [thing.thing.name, *_upon(thing.thing.name, placed)]
    return found


def _near(me: str, meant: list[str], placed: dict[str, Placed]) -> list[str]:
    """What an action of a player may be about: its station, and what lies there or is held."""
    here = placed[me].at if me in placed else None
    hosts = dict.fromkeys([*([here] if here else []), *meant[:1], me])
    found: dict[str, None] = {}
    for host in hosts:
        found.update(dict.fromkeys([host, *_upon(host, placed)]))
    return list(found)
