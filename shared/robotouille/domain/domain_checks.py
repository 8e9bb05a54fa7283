"""Checks of a domain's cross-references, which a schema cannot express.

Functions return all faults that they find and never raise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Set

from robotouille.domain.derived import (
    conditions_of_action,
    created_by,
    effects_of,
    parameter_types,
    placeholders,
)
from robotouille.domain.schema import (
    ActionDef,
    Condition,
    Creation,
    DomainFile,
    EffectDef,
    InputFile,
    LayoutRule,
    PredicateDef,
)
from robotouille.errors import Fault, bounded, did_you_mean, with_article

MAX_EFFECTS = 200
"""Largest number of effects of an action, at any depth."""
MAX_PLACEHOLDERS = 16
"""Largest number of names in braces in a sentence. Hundreds would make texts of gigabytes."""


def unknown(path: str, what: str, name: str, valid: Iterable[str]) -> Fault:
    """Return the fault of an unknown name, with the most similar valid name."""
    return Fault(path, f"unknown {what} {name!r}{did_you_mean(name, valid)}")


@bounded
def check_domain(domain: DomainFile) -> list[Fault]:
    """Find unknown or repeated names and wrong numbers and types of arguments."""
    faults = [
        *_check_extends(domain),
        *_repeated("object_types", domain.object_types),
        *_repeated("predicate_defs", [p.name for p in domain.predicate_defs]),
        *_repeated("action_defs", [a.name for a in domain.action_defs]),
    ]
    for key in ("player_types", "station_types"):
        for i, name in enumerate(getattr(domain, key)):
            if key in domain.model_fields_set and name not in domain.object_types:
                faults.append(unknown(f"{key}[{i}]", "object type", name, domain.object_types))
    for i, predicate in enumerate(domain.predicate_defs):
        faults += _check_predicate(f"predicate_defs[{i}]", predicate, domain)
    predicates = {p.name: p for p in domain.predicate_defs}
    for i, action in enumerate(domain.action_defs):
        faults += _check_action(f"action_defs[{i}]", action, predicates, domain)
    for i, rule in enumerate(domain.layout or ()):
        faults += _check_layout(f"layout[{i}]", rule, predicates)
    return faults


def _check_extends(domain: DomainFile) -> list[Fault]:
    # A domain in a message or a recording must not make the reader open files.
    message = "is allowed in files only; send the complete domain"
    return [Fault("extends", message)] if domain.extends is not None else []


def _repeated(path: str, names: Iterable[str]) -> list[Fault]:
    counts = Counter(names)
    return [Fault(path, f"{n!r} is defined {c} times") for n, c in counts.items() if c > 1]


def _check_predicate(path: str, predicate: PredicateDef, domain: DomainFile) -> list[Fault]:
    faults = [
        unknown(f"{path}.param_types[{i}]", "object type", kind, domain.object_types)
        for i, kind in enumerate(predicate.param_types)
        if kind not in domain.object_types
    ]
    positions = {str(i) for i in range(len(predicate.param_types))}
    for key, words in predicate.language_descriptors.items():
        where = f"{path}.language_descriptors.{key}"
        if key not in positions:
            faults.append(Fault(where, f"{predicate.name!r} has no argument {key}"))
        faults += _check_words(where, words, "argument", positions)
    return faults


def _check_layout(
    path: str, rule: LayoutRule, predicates: Mapping[str, PredicateDef]
) -> list[Fault]:
    faults = [
        unknown(where, "predicate", name, predicates)
        for where, name in [
            (f"{path}.predicate", rule.predicate),
            *((f"{path}.unless[{j}]", name) for j, name in enumerate(rule.unless or ())),
        ]
        if name not in predicates
    ]
    if rule.predicate in predicates:
        wanted = 1 if rule.when in (None, "top_of_stack") else 2
        found = len(predicates[rule.predicate].param_types)
        if found != wanted:
            kind = rule.when or "unless"
            message = (
                f"{kind!r} needs a predicate of {wanted}, but {rule.predicate!r} takes {found}"
            )
            faults.append(Fault(f"{path}.predicate", message))
    return faults


def _check_action(
    path: str, action: ActionDef, predicates: Mapping[str, PredicateDef], domain: DomainFile
) -> list[Fault]:
    count = sum(1 for _ in effects_of(f"{path}.sfx", action.sfx))
    if count > MAX_EFFECTS:
        message = f"{count:,} effects; at most {MAX_EFFECTS} are allowed"
        return [Fault(f"{path}.sfx", message)]
    faults = []
    types = _usual_types(path, action, predicates)
    for created in created_by(action.sfx):
        types[created.created_obj.param] = created.created_obj.type
        if created.created_obj.type not in domain.object_types:
            kind = created.created_obj.type
            faults.append(unknown(f"{path}.sfx", "object type", kind, domain.object_types))
        # Created objects are numbered: `bolt1` and `bolt` could both be called `bolt11`.
        if created.created_obj.name[-1:].isdigit():
            message = f"created_obj.name: {created.created_obj.name!r} must not end in a digit"
            faults.append(Fault(f"{path}.sfx", message))
    for where, condition in conditions_of_action(path, action):
        faults += _check_condition(where, condition, predicates, types)
    for where, effect in effects_of(f"{path}.sfx", action.sfx):
        if effect.param not in types:
            faults.append(unknown(f"{where}.param", "parameter", effect.param, types))
    lasting = types.keys() - {c.created_obj.param for c in created_by(action.sfx)}
    for name in action.travel or ():
        if name not in lasting:
            faults.append(unknown(f"{path}.travel", "parameter", name, lasting))
    where = f"{path}.language_description"
    faults += _check_words(where, action.language_description, "parameter", lasting)
    return faults + _check_scope(path, action)


def _usual_types(
    path: str, action: ActionDef, predicates: Mapping[str, PredicateDef]
) -> dict[str, str]:
    """Return the type that most conditions require of each parameter.

    The others are then wrong. If the first condition decided, one wrong predicate at the beginning
    would blame all the right ones.
    """
    votes: dict[str, Counter[str]] = {}
    for _, condition in conditions_of_action(path, action):
        definition = predicates.get(condition.predicate)
        if definition is not None and len(condition.params) == len(definition.param_types):
            for name, kind in zip(condition.params, definition.param_types, strict=True):
                votes.setdefault(name, Counter())[kind] += 1
    return {name: counts.most_common(1)[0][0] for name, counts in votes.items()}


def _check_scope(path: str, action: ActionDef) -> list[Fault]:
    """Find parameters of created objects outside the effects that create them."""
    created = {c.created_obj.param for c in created_by(action.sfx)}
    faults: list[Fault] = []

    def see(where: str, names: Iterable[str], known: Set[str]) -> None:
        for name in names:
            if name in created and name not in known:
                message = f"{name!r} is created by this action; only its creation can mention it"
                faults.append(Fault(where, message))

    def see_effects(where: str, effects: tuple[EffectDef, ...], known: Set[str]) -> None:
        for i, effect in enumerate(effects):
            here = f"{where}[{i}]"
            see(f"{here}.param", (effect.param,), known)
            for j, condition in enumerate(getattr(effect, "conditions", ())):
                see(f"{here}.conditions[{j}]", condition.params, known)
            inner = known
            if isinstance(effect, Creation):
                inner = known | {effect.created_obj.param}
            for j, condition in enumerate(effect.fx):
                see(f"{here}.fx[{j}]", condition.params, inner)
            see_effects(f"{here}.sfx", effect.sfx, inner)

    for field in ("precons", "immediate_fx"):
        for i, condition in enumerate(getattr(action, field)):
            see(f"{path}.{field}[{i}]", condition.params, frozenset())
    see_effects(f"{path}.sfx", action.sfx, frozenset())
    return faults


def _check_condition(
    path: str,
    condition: Condition,
    predicates: Mapping[str, PredicateDef],
    types: dict[str, str],
) -> list[Fault]:
    definition = predicates.get(condition.predicate)
    if definition is None:
        return [unknown(f"{path}.predicate", "predicate", condition.predicate, predicates)]
    expected = len(definition.param_types)
    if len(condition.params) != expected:
        found = len(condition.params)
        return [Fault(f"{path}.params", f"{definition.name!r} takes {expected}, found {found}")]
    faults = []
    for i, (name, kind) in enumerate(zip(condition.params, definition.param_types, strict=True)):
        known = types[name]
        if known != kind:
            is_one, needed = with_article(known), with_article(kind)
            message = f"{name!r} is {is_one} elsewhere in this action, here it must be {needed}"
            faults.append(Fault(f"{path}.params[{i}]", message))
    return faults


def _check_words(path: str, text: str, what: str, valid: Collection[str]) -> list[Fault]:
    """Check that braces in a text have valid names only, without formats or attributes."""
    try:
        names = placeholders(text)
    except ValueError as error:
        return [Fault(path, f"the braces do not match: {error}")]
    if len(names) > MAX_PLACEHOLDERS:
        message = f"{len(names)} names in braces; at most {MAX_PLACEHOLDERS} are allowed"
        return [Fault(path, message)]
    return [unknown(path, what, name, valid) for name in names if name not in valid]


@bounded
def check_input(inputs: InputFile, domain: DomainFile) -> list[Fault]:
    """Find actions and parameters of an input file that the domain does not have."""
    faults = []
    predicates = {p.name: p for p in domain.predicate_defs}
    actions = {a.name: parameter_types(a, predicates) for a in domain.action_defs}
    clicks = [
        (f"mouse_click_actions[{i}]", c.name, "click_on", c.input_instructions.click_on)
        for i, c in enumerate(inputs.mouse_click_actions)
    ]
    keys = [
        (f"keyboard_actions[{i}]", k.name, "at", k.input_instructions.at)
        for i, k in enumerate(inputs.keyboard_actions)
    ]
    for path, name, field, parameter in [*clicks, *keys]:
        if name not in actions:
            faults.append(unknown(f"{path}.name", "action", name, actions))
        elif parameter is not None and parameter not in actions[name]:
            where = f"{path}.input_instructions.{field}"
            faults.append(unknown(where, f"parameter of {name!r}", parameter, actions[name]))
    return faults
