"""Action schemas and ground actions.

A ground action is four integers. It is valid if `facts & tested == required`, and the facts after
it are `(facts | touched) ^ removed`. If static facts rule an action out, `required` has bits
outside `tested`, so that the test always fails.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from robotouille.domain.derived import parameter_types, placeholders
from robotouille.domain.schema import ActionDef, Condition, Creation, EffectDef, InstantEffect
from robotouille.domain.task import Task
from robotouille.world.grounding.effects import Effect


@dataclass(frozen=True, slots=True)
class EffectSchema:
    """A special effect of an action, with the parameters that it mentions (`variables`)."""

    definition: EffectDef
    variables: tuple[str, ...]
    types: tuple[str, ...]
    repeats: bool


@dataclass(frozen=True)
class ActionSchema:
    """An action over typed parameters.

    The acting player comes first, if the action has one. The other parameters follow in the order
    in which the action's sentence mentions them. `born` are the effects that start when one of
    the action's effects creates or deletes an object.
    """

    index: int
    name: str
    definition: ActionDef
    parameters: tuple[tuple[str, str], ...]
    player: bool
    effects: tuple[EffectSchema, ...]
    born: tuple[EffectSchema, ...]

    @property
    def all_effects(self) -> tuple[EffectSchema, ...]:
        """The effects and the born effects, in the order of effect numbers."""
        return self.effects + self.born

    def bind(self, arguments: tuple[str, ...]) -> dict[str, str]:
        return {name: a for (name, _), a in zip(self.parameters, arguments, strict=True)}


class ActionSource(Protocol):
    """Source of ground actions: a world, which has one object for each name and arguments."""

    task: Task

    def action(self, name: str, *arguments: str) -> GroundAction: ...

    def admit(self, names: Iterable[str]) -> None: ...


class GroundAction:
    """An action with its arguments, e.g. `move(robot1, table1, table2)`.

    Actions are equal if their names and arguments are. A world accepts actions of another world
    of the same task. Copying returns the same object; pickled actions are loaded into the world
    of the receiving process.

    Attributes:
        key: Sort key: the domain's order of actions, then the order of their arguments.
        effects: The special effects that the action starts.
        reads: Mask of the atoms on which these effects depend.
        duration: Number of steps that the action takes.
        source: The world to which the masks belong.
        serial: Number of the action in that world.
    """

    __slots__ = (
        "_hash", "arguments", "duration", "effects", "key", "name", "player", "reads",
        "removed", "required", "schema", "sentence", "serial", "source", "tested", "touched",
    )  # fmt: skip

    def __init__(
        self,
        source: ActionSource,
        schema: ActionSchema,
        arguments: tuple[str, ...],
        key: tuple[int, ...],
        sentence: str,
        serial: int,
    ) -> None:
        self.source = source
        self.serial = serial
        self.schema = schema
        self.name = schema.name
        self.arguments = arguments
        self.player = arguments[0] if schema.player else None
        self.key = key
        self.sentence = sentence
        self.tested = self.required = self.touched = self.removed = self.reads = 0
        self.effects: tuple[Effect, ...] = ()
        self.duration = 1
        # Actions are hashed far more often than they are made.
        self._hash = hash((self.name, arguments))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GroundAction):
            return NotImplemented
        return self is other or (self.name, self.arguments) == (other.name, other.arguments)

    def __hash__(self) -> int:
        return self._hash

    @property
    def origin(self) -> str | None:
        """The station where a walk begins; None for other actions."""
        travel = self.schema.definition.travel
        return None if travel is None else self.schema.bind(self.arguments)[travel[0]]

    @property
    def destination(self) -> str | None:
        """The station where a walk ends; None for other actions."""
        travel = self.schema.definition.travel
        return None if travel is None else self.schema.bind(self.arguments)[travel[1]]

    def __copy__(self) -> GroundAction:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> GroundAction:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _from_source, (self.source, self.name, self.arguments)

    def __repr__(self) -> str:
        return f"<{self}>"

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.arguments)})"


def _from_source(source: ActionSource, name: str, arguments: tuple[str, ...]) -> GroundAction:
    # The action may mention created objects that this process has not seen yet.
    source.admit(arguments)
    return source.action(name, *arguments)


def compile_schemas(task: Task) -> tuple[ActionSchema, ...]:
    """Return the domain's actions with typed parameters, in the domain's order."""
    predicates = {p.name: p for p in task.domain.predicate_defs}
    schemas = []
    for index, definition in enumerate(task.domain.action_defs):
        types = parameter_types(definition, predicates)
        actor = next((n for n, kind in types.items() if kind in task.domain.player_types), None)
        mentioned = [n for n in placeholders(definition.language_description) if n in types]
        order = list(dict.fromkeys([*([actor] if actor else []), *mentioned, *types]))
        schemas.append(
            ActionSchema(
                index=index,
                name=definition.name,
                definition=definition,
                parameters=tuple((name, types[name]) for name in order),
                player=actor is not None,
                effects=tuple(_effect(e, types) for e in definition.sfx),
                born=tuple(_born(definition.sfx, types)),
            )
        )
    return tuple(schemas)


def _effect(definition: EffectDef, types: Mapping[str, str]) -> EffectSchema:
    effects = _walk((definition,))
    created = {e.created_obj.param for e in effects if isinstance(e, Creation)}
    mentioned = dict.fromkeys(n for n in _variables(definition) if n not in created)
    kinds = tuple(types[name] for name in mentioned)
    return EffectSchema(definition, tuple(mentioned), kinds, _repeats(definition))


def _born(effects: Iterable[EffectDef], types: Mapping[str, str]) -> Iterator[EffectSchema]:
    """Yield the effects nested in instant ones. They start separately, so they need numbers."""
    for effect in effects:
        known = types
        if isinstance(effect, Creation):
            known = {**types, effect.created_obj.param: effect.created_obj.type}
        if isinstance(effect, InstantEffect):
            yield from (_effect(nested, known) for nested in effect.sfx)
        yield from _born(effect.sfx, known)


def _walk(effects: tuple[EffectDef, ...]) -> Iterator[EffectDef]:
    for effect in effects:
        yield effect
        yield from _walk(effect.sfx)


def _variables(effect: EffectDef) -> Iterator[str]:
    yield effect.param
    conditions: tuple[Condition, ...] = (*getattr(effect, "conditions", ()), *effect.fx)
    for condition in conditions:
        yield from condition.params
    for nested in effect.sfx:
        yield from _variables(nested)


def _repeats(effect: EffectDef) -> bool:
    return effect.counts == "performances" or any(_repeats(e) for e in effect.sfx)


def walking_steps(distance: int, steps_per_tile: int) -> int:
    """Return the number of steps that a walk of `distance` tiles takes, at least one."""
    return max(1, math.ceil(distance * steps_per_tile))
