"""Action schemas, compiled once, and ground actions, made when first needed.

A ground action is four integers: it applies in `facts` if `facts & tested == required`, and turns
them into `(facts | touched) ^ removed`. One that static facts rule out has `required` outside
`tested`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from robotouille.domain.checks.derived import parameter_types, placeholders
from robotouille.domain.schema import ActionDef, Condition, Creation, Deletion, EffectDef
from robotouille.domain.task import Task
from robotouille.world.grounding.effects import Effect

__all__ = ["ActionSchema", "ActionSource", "EffectSchema", "GroundAction", "compile_schemas"]


@dataclass(frozen=True, slots=True)
class EffectSchema:
    """A special effect of an action; `variables` are the parameters it speaks of."""

    definition: EffectDef
    variables: tuple[str, ...]
    repeats: bool


@dataclass(frozen=True)
class ActionSchema:
    """An action over typed parameters: the acting player's first, if it has one, then the others
    in the order in which the action's sentence mentions them."""

    index: int
    name: str
    definition: ActionDef
    parameters: tuple[tuple[str, str], ...]
    player: bool
    effects: tuple[EffectSchema, ...]
    born: tuple[EffectSchema, ...]

    @property
    def all_effects(self) -> tuple[EffectSchema, ...]:
        """Its own effects, then those that start when one of them creates or deletes."""
        return self.effects + self.born

    def bind(self, arguments: tuple[str, ...]) -> dict[str, str]:
        return {name: a for (name, _), a in zip(self.parameters, arguments, strict=True)}


class ActionSource(Protocol):
    """What ground actions come from: a world hands out one for each name and arguments."""

    task: Task

    def action(self, name: str, *arguments: str) -> GroundAction: ...

    def admit(self, names: Iterable[str]) -> None: ...


class GroundAction:
    """An action with its arguments, e.g. `move(robot1, table1, table2)`.

    `key` orders actions as the domain lists them, then by their arguments' order. `effects` are
    the special effects it starts, `reads` the atoms on which these depend, `duration` the steps
    it takes (1 but for timing profiles). `source` is the world whose bits its masks are, `serial`
    tells it from the others of that world.

    Actions are equal if their names and arguments are. `pickle` and `copy` work: a copy is the
    same object, and a world of the same task takes another's actions for its own.
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
        self._hash = hash((self.name, arguments))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GroundAction):
            return NotImplemented
        return self is other or (self.name, self.arguments) == (other.name, other.arguments)

    def __hash__(self) -> int:
        return self._hash

    @property
    def origin(self) -> str | None:
        """The station where a walk begins; None for what is no walk."""
        travel = self.schema.definition.travel
        return None if travel is None else self.schema.bind(self.arguments)[travel[0]]

    @property
    def destination(self) -> str | None:
        """The station where a walk ends; None for what is no walk."""
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
    source.admit(arguments)
    return source.action(name, *arguments)


def compile_schemas(task: Task) -> tuple[ActionSchema, ...]:
    """The domain's actions with typed parameters, in the domain's order."""
    predicates = {p.name: p for p in task.domain.predicate_defs}
    schemas = []
    for index, definition in enumerate(task.domain.action_defs):
        types = parameter_types(definition, predicates)
        actor = next((n for n, kind in types.items() if kind in task.domain.player_types), None)
        said = [n for n in placeholders(definition.language_description) if n in types]
        order = list(dict.fromkeys([*([actor] if actor else []), *said, *types]))
        instants = [e for e in _walk(definition.sfx) if isinstance(e, Creation | Deletion)]
        born = [nested for effect in instants for nested in effect.sfx]
        schemas.append(
            ActionSchema(
                index=index,
                name=definition.name,
                definition=definition,
                parameters=tuple((name, types[name]) for name in order),
                player=actor is not None,
                effects=tuple(_effect(e) for e in definition.sfx),
                born=tuple(_effect(e) for e in born),
            )
        )
    return tuple(schemas)


def _effect(definition: EffectDef) -> EffectSchema:
    effects = _walk((definition,))
    created = {e.created_obj.param for e in effects if isinstance(e, Creation)}
    mentioned = dict.fromkeys(n for n in _variables(definition) if n not in created)
    return EffectSchema(definition, tuple(mentioned), _repeats(definition))


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
    return effect.type == "repetitive" or any(_repeats(e) for e in effect.sfx)


def walking_steps(distance: int, steps_per_tile: int) -> int:
    """How many steps a walk of `distance` tiles takes; at least one."""
    return max(1, math.ceil(distance * steps_per_tile))
