"""Facts derived from a domain's definitions: parameters, fluents, created kinds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from string import Formatter

from robotouille.domain.schema import (
    ActionDef,
    Condition,
    Creation,
    DomainFile,
    EffectDef,
    PredicateDef,
)


def parameter_types(action: ActionDef, predicates: Mapping[str, PredicateDef]) -> dict[str, str]:
    """Return an action's parameters in order of first mention, with their types."""
    types: dict[str, str] = {}
    for condition in _conditions(action):
        definition = predicates.get(condition.predicate)
        if definition is not None:
            for name, kind in zip(condition.params, definition.param_types, strict=False):
                types.setdefault(name, kind)
    # A created object is chosen by the simulator, not by the acting player.
    for created in created_by(action.sfx):
        types.pop(created.created_obj.param, None)
    return types


def fluents(domain: DomainFile) -> frozenset[str]:
    """Return the predicates that some action can change; all others are static."""
    return frozenset(
        result.predicate
        for action in domain.action_defs
        for results in (action.immediate_fx, *(effect.fx for effect in _effects(action.sfx)))
        for result in results
    )


def created_kinds(domain: DomainFile) -> list[str]:
    """Return the kinds of objects that actions create."""
    made = [c.created_obj.name for a in domain.action_defs for c in created_by(a.sfx)]
    return list(dict.fromkeys(made))


def domain_kinds(domain: DomainFile) -> dict[str, str]:
    """Return the kinds of objects that a domain mentions, with their types.

    They are its types, the kinds of created objects, and a kind `x` for each unary predicate
    `isx`, which is the fact that an object is of kind `x`.
    """
    kinds = {kind: kind for kind in domain.object_types}
    for predicate in domain.predicate_defs:
        if predicate.name.startswith("is") and len(predicate.param_types) == 1:
            kinds.setdefault(predicate.name[2:], predicate.param_types[0])
    for action in domain.action_defs:
        for created in created_by(action.sfx):
            kinds[created.created_obj.name] = created.created_obj.type
    return kinds


def conditions_of_action(path: str, action: ActionDef) -> Iterator[tuple[str, Condition]]:
    """Yield an action's conditions and results with their paths in the file."""
    for field in ("precons", "immediate_fx"):
        for i, condition in enumerate(getattr(action, field)):
            yield f"{path}.{field}[{i}]", condition
    for where, effect in effects_of(f"{path}.sfx", action.sfx):
        for i, condition in enumerate(getattr(effect, "conditions", ())):
            yield f"{where}.conditions[{i}]", condition
        for i, condition in enumerate(effect.fx):
            yield f"{where}.fx[{i}]", condition


def effects_of(path: str, effects: tuple[EffectDef, ...]) -> Iterator[tuple[str, EffectDef]]:
    """Yield special effects, nested ones included, with their paths in the file."""
    for i, effect in enumerate(effects):
        yield f"{path}[{i}]", effect
        yield from effects_of(f"{path}[{i}].sfx", effect.sfx)


def created_by(effects: tuple[EffectDef, ...]) -> Iterator[Creation]:
    """Yield the effects, nested ones included, that create an object."""
    for effect in _effects(effects):
        if isinstance(effect, Creation):
            yield effect


def _conditions(action: ActionDef) -> Iterator[Condition]:
    """Yield the conditions of `conditions_of_action` without paths, which take time to write."""
    yield from action.precons
    yield from action.immediate_fx
    for effect in _effects(action.sfx):
        yield from getattr(effect, "conditions", ())
        yield from effect.fx


def _effects(effects: tuple[EffectDef, ...]) -> Iterator[EffectDef]:
    """Yield the effects of `effects_of` without paths."""
    for effect in effects:
        yield effect
        yield from _effects(effect.sfx)


def placeholders(text: str) -> list[str]:
    """Return what a text has in braces, in order.

    Raises:
        ValueError: A brace has no partner.
    """
    found = []
    for _, name, layout, conversion in Formatter().parse(text):
        if name is not None:
            tail = f"!{conversion}" if conversion else ""
            found.append(name + tail + (f":{layout}" if layout else ""))
    return found
