"""What a click or a key means: the ground action of a domain's input file.

Pure: names of objects, buttons and keys in, an action out. The window finds out which object is
under the mouse.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.schema import InputFile
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.scene import Placed, scene
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
    """Reads the mouse and the keyboard of one player's owner."""

    def __init__(self, world: World, bindings: InputFile | None = None) -> None:
        self.world = world
        self.bindings = bindings or bindings_of(world.task)
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

    def click(self, state: State, me: str, target: str, button: Button = "left") -> Meaning:
        """What clicking on an object means; what lies on it can be meant as well."""
        placed = scene(state)
        meant = [target, *_upon(target, placed)]
        return self._meaning(state, me, self._clicks.get(button, []), meant, placed)

    def key(self, state: State, me: str, key: str) -> Meaning:
        """What a key means where the player is."""
        placed = scene(state)
        at = placed[me].at if me in placed else None
        bindings = self._keys.get(key.casefold(), [])
        return self._meaning(state, me, bindings, [at] if at else [], placed)

    def options(self, state: State, me: str) -> tuple[Option, ...]:
        """The keys whose action is valid now, but for those that are always."""
        found = []
        for key, bindings in self._keys.items():
            if all(binding.parameter is None for binding in bindings):
                continue
            meaning = self.key(state, me, key)
            if meaning.valid and meaning.action is not None:
                found.append(Option(key, meaning.action))
        return tuple(found)

    def help(self) -> tuple[tuple[str, str], ...]:
        """Rows of (input, what it does): of the input file, then those that are made up."""
        rows = []
        for button, bindings in self._clicks.items():
            rows.append((f"{button.capitalize()} click", _names(bindings)))
        for key, bindings in self._keys.items():
            rows.append((key.upper() if len(key) == 1 else key.capitalize(), _names(bindings)))
        return tuple(rows)

    def _meaning(
        self,
        state: State,
        me: str,
        bindings: list[_KeyBinding],
        meant: list[str],
        placed: dict[str, Placed],
    ) -> Meaning:
        if not bindings:
            return Meaning(None, "")
        busy = state.busy_steps(me)
        if busy:
            return Meaning(None, f"{me} is busy for {busy} more step{'s' * (busy > 1)}")
        valid = state.actions(me)
        for binding in bindings:
            for action in valid:
                if action.schema is binding.schema and _fits(action, binding, meant):
                    return Meaning(action, action.sentence, True)
        return self._attempt(state, me, bindings, meant, placed)

    def _attempt(
        self,
        state: State,
        me: str,
        bindings: list[_KeyBinding],
        meant: list[str],
        placed: dict[str, Placed],
    ) -> Meaning:
        """The action that is nearest to being valid: its rejection will say what is amiss."""
        near = _near(me, meant, placed)
        best, fewest, reason = None, _NEAR_MISS + 1, ""
        for binding in bindings:
            for action in self._candidates(binding, me, meant, near):
                unmet = self.world.unmet(state, action)
                if len(unmet) < fewest:
                    best, fewest, reason = action, len(unmet), unmet[0].words
        if best is None:
            where = meant[0] if meant else "here"
            return Meaning(None, f"nothing to do at {where}" if meant else "nothing to do here")
        return Meaning(best, f"{best.sentence}? Needs: {reason}")

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


def _fits(action: GroundAction, binding: _KeyBinding, meant: list[str]) -> bool:
    if binding.parameter is None:
        return True
    return action.schema.bind(action.arguments).get(binding.parameter) in meant


def _names(bindings: list[_KeyBinding]) -> str:
    return ", ".join(binding.schema.name.replace("-", " ") for binding in bindings)


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
