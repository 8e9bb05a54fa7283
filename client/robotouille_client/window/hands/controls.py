"""What a click or a key means: the ground action of a domain's input file.

Pure: names of objects, buttons and keys in, an action out. The window finds out which object is
under the mouse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.rendering import Language, language_of
from robotouille.domain.schema import InputFile
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.near_misses import InputBinding, NearMisses, Situation, things_upon
from robotouille.world.people.templates import capitalised
from robotouille.world.people.usefulness import useful_actions, work_in_progress
from robotouille.world.people.wording import Wording
from robotouille.world.scene import scene
from robotouille.world.world import State, World

__all__ = ["Button", "Controls", "Meaning", "Option"]

Button = Literal["left", "middle", "right"]


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a click or key would do: an action, which is `valid` or will be rejected, or none.

    `hint` says it in words; where it cannot be done, why, or (`advice`) what to do about that.
    """

    action: GroundAction | None
    hint: str
    valid: bool = False
    advice: bool = False


@dataclass(frozen=True, slots=True)
class Option:
    """A key and what pressing it would do now."""

    key: str
    action: GroundAction


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
        schemas = {schema.name: schema for schema in world.schemas}
        self._clicks: dict[str, list[InputBinding]] = {}
        self._keys: dict[str, list[InputBinding]] = {}
        for click in self.bindings.mouse_click_actions:
            how = click.input_instructions
            if click.name in schemas:
                binding = InputBinding(schemas[click.name], how.click_on)
                self._clicks.setdefault(how.button, []).append(binding)
        for key in self.bindings.keyboard_actions:
            if key.name in schemas:
                binding = InputBinding(schemas[key.name], key.input_instructions.at)
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
        situation = Situation(state, me, scene(state))
        own = self._clicks.get(button, [])
        others = self._keys_at_a_place() if own and target == situation.at else []
        return self._meaning(
            situation, own, others, [target, *things_upon(target, situation.placed)]
        )

    def key(self, state: State, me: str, key: str) -> Meaning:
        """What a key means where the player is."""
        situation = Situation(state, me, scene(state))
        own = self._keys.get(key.casefold(), [])
        here = [situation.at, *things_upon(situation.at, situation.placed)] if situation.at else []
        at_a_place = any(binding.parameter for binding in own)
        others = self._clicks.get("left", []) if at_a_place and here else []
        return self._meaning(situation, own, others, here)

    def options(self, state: State, me: str) -> tuple[Option, ...]:
        """The keys whose own action is valid now and changes something, but for those that always
        are."""
        situation, found = Situation(state, me, scene(state)), []
        here = [situation.at] if situation.at else []
        for key, bindings in self._keys.items():
            if all(binding.parameter is None for binding in bindings):
                continue
            action = _useful(situation, bindings, here)
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

    def _names(self, bindings: list[InputBinding]) -> str:
        """What actions do, of whatever it may be."""
        wording = self.wording(None)
        return ", ".join(dict.fromkeys(wording.in_general(each.schema) for each in bindings))

    def _keys_at_a_place(self) -> list[InputBinding]:
        return [each for bindings in self._keys.values() for each in bindings if each.parameter]

    def _meaning(
        self,
        situation: Situation,
        own: list[InputBinding],
        others: list[InputBinding],
        meant: list[str],
    ) -> Meaning:
        if not own:
            return Meaning(None, "")
        state, me = situation.state, situation.me
        busy = state.busy_steps(me)
        if busy:
            return Meaning(None, f"you are busy for {busy} more step{'s' * (busy > 1)}")
        action = _useful(situation, own, meant)
        at_work = action is None and _is_at_work(situation, own, meant)
        if action is None and not at_work:
            action = _useful(situation, others, meant)
        if action is not None:
            return Meaning(action, capitalised(self.wording(me).action(action, state)), True)
        misses = NearMisses(self.world, self.wording(me))
        miss = misses.nearest(situation, [*own, *others], meant, at_work=at_work)
        return Meaning(miss.action, miss.words, advice=miss.advice)


def _useful(
    situation: Situation, bindings: list[InputBinding], meant: list[str]
) -> GroundAction | None:
    """The first action of some bindings that is valid and changes something."""
    valid = useful_actions(situation.state, situation.me) if bindings else ()
    for binding in bindings:
        for action in valid:
            if action.schema is binding.schema and _fits(action, binding, meant):
                return action
    return None


def _is_at_work(situation: Situation, bindings: list[InputBinding], meant: list[str]) -> bool:
    """Whether what some bindings do here is going on or done: an input that comes once too often
    is then not taken for another."""
    if any(row.subject in meant for row in work_in_progress(situation.state)):
        return True
    valid = situation.state.actions(situation.me)
    return any(a.schema is b.schema and _fits(a, b, meant) for b in bindings for a in valid)


def _fits(action: GroundAction, binding: InputBinding, meant: list[str]) -> bool:
    if binding.parameter is None:
        return True
    return action.schema.bind(action.arguments).get(binding.parameter) in meant
