"""Cross-references of a domain and of a problem: what a schema cannot see.

Every function returns all the faults it finds; none raises.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Set
from math import prod
from string import Formatter

from robotouille.domain.schema import (
    ActionDef,
    Condition,
    Creation,
    Delayed,
    DomainFile,
    EffectDef,
    InputFile,
    LayoutRule,
    PredicateDef,
    ProblemFile,
    Repetitive,
)
from robotouille.errors import Fault, did_you_mean

__all__ = [
    "check_domain",
    "check_input",
    "check_problem",
    "created_kinds",
    "fluents",
    "parameter_types",
    "placeholders",
]

MAX_FACTS, MAX_CHOICES = 20_000, 10_000_000
"""Facts that play can change, and ways to do one action, in a task."""


def check_domain(domain: DomainFile) -> list[Fault]:
    """Unknown or repeated names, wrong numbers and types of arguments."""
    faults = [
        *_not_whole(domain),
        *_repeated("object_types", domain.object_types),
        *_repeated("predicate_defs", [p.name for p in domain.predicate_defs]),
        *_repeated("action_defs", [a.name for a in domain.action_defs]),
    ]
    for key in ("player_types", "station_types"):
        for i, name in enumerate(getattr(domain, key)):
            if key in domain.model_fields_set and name not in domain.object_types:
                faults.append(_unknown(f"{key}[{i}]", "object type", name, domain.object_types))
    for i, predicate in enumerate(domain.predicate_defs):
        faults += _check_predicate(f"predicate_defs[{i}]", predicate, domain)
    predicates = {p.name: p for p in domain.predicate_defs}
    for i, action in enumerate(domain.action_defs):
        faults += _check_action(f"action_defs[{i}]", action, predicates, domain)
    for i, rule in enumerate(domain.layout or ()):
        faults += _check_layout(f"layout[{i}]", rule, predicates)
    return faults


def parameter_types(action: ActionDef, predicates: Mapping[str, PredicateDef]) -> dict[str, str]:
    """The parameters of an action in order of first mention, each with its type."""
    types: dict[str, str] = {}
    for _, condition in _conditions_of_action("", action):
        definition = predicates.get(condition.predicate)
        if definition is not None:
            for name, kind in zip(condition.params, definition.param_types, strict=False):
                types.setdefault(name, kind)
    for created in _created(action.sfx):
        types.pop(created.created_obj.param, None)
    return types


def fluents(domain: DomainFile) -> frozenset[str]:
    """The predicates that some action can change; all others are static."""
    return frozenset(
        condition.predicate
        for action in domain.action_defs
        for path, condition in _conditions_of_action("", action)
        if ".precons" not in path and ".conditions" not in path
    )


def created_kinds(domain: DomainFile) -> list[str]:
    """The kinds of the objects that some action makes."""
    made = [c.created_obj.name for a in domain.action_defs for c in _created(a.sfx)]
    return list(dict.fromkeys(made))


def check_problem(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    """Objects off the grid or of unknown types, unknown predicates, ill-formed goals."""
    return [
        *_check_objects(problem, domain),
        *_check_goal(problem, domain),
        *_check_config(problem, domain),
        *_check_ground(problem),
        *_check_size(problem, domain),
    ]


def check_input(inputs: InputFile, domain: DomainFile) -> list[Fault]:
    """Actions and parameters that the domain does not have."""
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
            faults.append(_unknown(f"{path}.name", "action", name, actions))
        elif parameter is not None and parameter not in actions[name]:
            where = f"{path}.input_instructions.{field}"
            faults.append(_unknown(where, f"parameter of {name!r}", parameter, actions[name]))
    return faults


def _unknown(path: str, what: str, name: str, valid: Iterable[str]) -> Fault:
    return Fault(path, f"unknown {what} {name!r}{did_you_mean(name, valid)}")


def _not_whole(domain: DomainFile) -> list[Fault]:
    """A domain that came in a message or a recording must not send for files."""
    message = "is for files: here the domain has to be whole"
    return [Fault("extends", message)] if domain.extends is not None else []


def _repeated(path: str, names: Iterable[str]) -> list[Fault]:
    counts = Counter(names)
    return [Fault(path, f"{n!r} is defined {c} times") for n, c in counts.items() if c > 1]


def _check_predicate(path: str, predicate: PredicateDef, domain: DomainFile) -> list[Fault]:
    faults = [
        _unknown(f"{path}.param_types[{i}]", "object type", kind, domain.object_types)
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
        _unknown(where, "predicate", name, predicates)
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
            message = f"{kind!r} is about a predicate of {wanted}; {rule.predicate!r} takes {found}"
            faults.append(Fault(f"{path}.predicate", message))
    return faults


def _check_action(
    path: str, action: ActionDef, predicates: Mapping[str, PredicateDef], domain: DomainFile
) -> list[Fault]:
    faults = []
    types: dict[str, str] = {}
    for created in _created(action.sfx):
        types[created.created_obj.param] = created.created_obj.type
        if created.created_obj.type not in domain.object_types:
            kind = created.created_obj.type
            faults.append(_unknown(f"{path}.sfx", "object type", kind, domain.object_types))
    for where, condition in _conditions_of_action(path, action):
        faults += _check_condition(where, condition, predicates, types)
    for where, effect in _effects(f"{path}.sfx", action.sfx):
        if effect.param not in types:
            faults.append(_unknown(f"{where}.param", "parameter", effect.param, types))
    lasting = types.keys() - {c.created_obj.param for c in _created(action.sfx)}
    for name in action.travel or ():
        if name not in lasting:
            faults.append(_unknown(f"{path}.travel", "parameter", name, lasting))
    where = f"{path}.language_description"
    faults += _check_words(where, action.language_description, "parameter", lasting)
    return faults + _check_scope(path, action)


def _check_scope(path: str, action: ActionDef) -> list[Fault]:
    """A created object is known inside its creation only."""
    created = {c.created_obj.param for c in _created(action.sfx)}
    faults: list[Fault] = []

    def see(where: str, names: Iterable[str], known: Set[str]) -> None:
        for name in names:
            if name in created and name not in known:
                message = f"{name!r} is created by this action; only its creation can speak of it"
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
        return [_unknown(f"{path}.predicate", "predicate", condition.predicate, predicates)]
    expected = len(definition.param_types)
    if len(condition.params) != expected:
        found = len(condition.params)
        return [Fault(f"{path}.params", f"{definition.name!r} takes {expected}, found {found}")]
    faults = []
    for i, (name, kind) in enumerate(zip(condition.params, definition.param_types, strict=True)):
        known = types.setdefault(name, kind)
        if known != kind:
            message = f"{name!r} is a {known} elsewhere in this action, here it must be a {kind}"
            faults.append(Fault(f"{path}.params[{i}]", message))
    return faults


def _conditions_of_action(path: str, action: ActionDef) -> Iterator[tuple[str, Condition]]:
    for field in ("precons", "immediate_fx"):
        for i, condition in enumerate(getattr(action, field)):
            yield f"{path}.{field}[{i}]", condition
    for where, effect in _effects(f"{path}.sfx", action.sfx):
        for i, condition in enumerate(getattr(effect, "conditions", ())):
            yield f"{where}.conditions[{i}]", condition
        for i, condition in enumerate(effect.fx):
            yield f"{where}.fx[{i}]", condition


def _effects(path: str, effects: tuple[EffectDef, ...]) -> Iterator[tuple[str, EffectDef]]:
    for i, effect in enumerate(effects):
        yield f"{path}[{i}]", effect
        yield from _effects(f"{path}[{i}].sfx", effect.sfx)


def _created(effects: tuple[EffectDef, ...]) -> Iterator[Creation]:
    for _, effect in _effects("", effects):
        if isinstance(effect, Creation):
            yield effect


def placeholders(text: str) -> list[str]:
    """What is in braces, in order; ValueError where a brace has no partner."""
    found = []
    for _, name, layout, conversion in Formatter().parse(text):
        if name is not None:
            tail = f"!{conversion}" if conversion else ""
            found.append(name + tail + (f":{layout}" if layout else ""))
    return found


def _check_words(path: str, text: str, what: str, valid: Collection[str]) -> list[Fault]:
    """Words with names in braces, plain ones: no formats, no attributes."""
    try:
        names = placeholders(text)
    except ValueError as error:
        return [Fault(path, f"the braces do not match: {error}")]
    return [_unknown(path, what, name, valid) for name in names if name not in valid]


def _list_name(kind: str) -> str:
    return f"{kind}s"


def _check_objects(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    faults = []
    predicates = {p.name: p for p in domain.predicate_defs}
    ids: set[str | int] = set()
    for kind, objects in problem.objects.items():
        if kind not in domain.object_types:
            faults.append(_unknown(_list_name(kind), "object type", kind, domain.object_types))
        for i, obj in enumerate(objects):
            path = f"{_list_name(kind)}[{i}]"
            if obj.x >= problem.width or obj.y >= problem.height:
                size = f"{problem.width} by {problem.height}"
                faults.append(Fault(path, f"({obj.x}, {obj.y}) is off the {size} grid"))
            for j, name in enumerate(obj.predicates):
                where = f"{path}.predicates[{j}]"
                if name not in predicates:
                    faults.append(_unknown(where, "predicate", name, predicates))
                elif predicates[name].param_types != (kind,):
                    faults.append(Fault(where, f"{name!r} does not describe a single {kind}"))
            if obj.id is not None:
                if obj.id in ids:
                    faults.append(Fault(f"{path}.id", f"the id {obj.id!r} is used twice"))
                ids.add(obj.id)
    if not any(problem.objects.get(kind) for kind in domain.player_types):
        faults.append(Fault("", f"has no {' or '.join(domain.player_types)}"))
    unknown = _unknown_kinds(problem, domain)
    return faults + unknown + _check_names(problem) + _check_seats(problem, domain)


def _unknown_kinds(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    """Kinds that nothing tells anything of, where the domain lists those of their type.

    A problem may bring kinds of its own, so this is no error.
    """
    faults = []
    known = {kind for kind, of in _domain_kinds(domain).items() if of != kind}
    for type_, objects in problem.objects.items():
        listed = domain.kinds.get(type_, ())
        for i, obj in enumerate(objects):
            if listed and not obj.predicates and obj.name not in (type_, *listed, *known):
                message = f"unknown {type_} kind {obj.name!r}{did_you_mean(obj.name, listed)}"
                faults.append(Fault(f"{_list_name(type_)}[{i}].name", message, "warning"))
    return faults


def _check_names(problem: ProblemFile) -> list[Fault]:
    """Numbered objects of two kinds must not get one name, nor one kind be of two types."""
    owners: dict[str, tuple[str, str]] = {}
    clashes: dict[tuple[str, str], Fault] = {}
    for type_, objects in problem.objects.items():
        for kind, count in Counter(obj.name for obj in objects).items():
            for number in range(1, count + 1):
                other = owners.setdefault(f"{kind}{number}", (type_, kind))
                if other != (type_, kind):
                    message = f"{kind!r} and the {other[0]} {other[1]!r} both name {kind}{number}"
                    clashes.setdefault((type_, kind), Fault(_list_name(type_), message))
    return list(clashes.values())


def _check_seats(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    players = sum(len(problem.objects.get(kind, ())) for kind in domain.player_types)
    return [
        Fault(f"seats[{i}]", f"{count} seats, but the problem lists {players} players")
        for i, count in enumerate(problem.seats or ())
        if count > players
    ]


def _check_goal(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    faults = []
    predicates = {p.name: p for p in domain.predicate_defs}
    kinds = _kinds(problem, domain)
    ids = {
        o.id: kind for kind, objects in problem.objects.items() for o in objects if o.id is not None
    }
    first: dict[int | str, str] = {}
    for i, term in enumerate(problem.goal):
        path = f"goal[{i}]"
        definition = predicates.get(term.predicate)
        if definition is None:
            faults.append(_unknown(f"{path}.predicate", "predicate", term.predicate, predicates))
            continue
        if len(term.args) != len(definition.param_types):
            expected = len(definition.param_types)
            message = f"{term.predicate!r} takes {expected}, found {len(term.args)}"
            faults.append(Fault(f"{path}.args", message))
            continue
        for j, (kind, wanted) in enumerate(zip(term.args, definition.param_types, strict=True)):
            where = f"{path}.args[{j}]"
            if kind not in kinds:
                faults.append(_unknown(where, "kind of object", kind, kinds))
            elif kinds[kind] != wanted:
                message = f"{kind!r} is a {kinds[kind]}, {term.predicate!r} needs a {wanted}"
                faults.append(Fault(where, message))
            identifier = term.ids[j]
            if isinstance(identifier, str) and identifier not in ids:
                message = f"no object has the id {identifier!r}"
                message += did_you_mean(identifier, (str(x) for x in ids))
                faults.append(Fault(f"{path}.ids[{j}]", message))
            known = first.setdefault(identifier, kind)
            found = ids.get(identifier) if isinstance(identifier, str) else kinds.get(known)
            if kind in kinds and found not in (None, kinds[kind]):
                message = f"the object {identifier!r} is a {found}, {kind!r} is a {kinds[kind]}"
                faults.append(Fault(f"{path}.ids[{j}]", message))
            elif known != kind:
                message = f"the object {identifier!r} is called {known!r} first and {kind!r} here"
                faults.append(Fault(where, f"{message}; the first counts", "warning"))
    return faults


def _kinds(problem: ProblemFile, domain: DomainFile) -> dict[str, str]:
    kinds = _domain_kinds(domain)
    for kind, objects in problem.objects.items():
        kinds.update({obj.name: kind for obj in objects})
    return kinds


def _domain_kinds(domain: DomainFile) -> dict[str, str]:
    """The kinds that a domain speaks of, each with its type."""
    kinds = {kind: kind for kind in domain.object_types}
    for predicate in domain.predicate_defs:
        if predicate.name.startswith("is") and len(predicate.param_types) == 1:
            kinds.setdefault(predicate.name[2:], predicate.param_types[0])
    for action in domain.action_defs:
        for created in _created(action.sfx):
            kinds[created.created_obj.name] = created.created_obj.type
    return kinds


def _check_config(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    keys = {
        effect.config
        for action in domain.action_defs
        for _, effect in _effects("", action.sfx)
        if isinstance(effect, Delayed | Repetitive) and effect.config is not None
    }
    return [
        _unknown(f"config.{key}", "configuration key", key, sorted(keys))
        for key in problem.config
        if key not in keys
    ]


def _check_ground(problem: ProblemFile) -> list[Fault]:
    if problem.ground is None:
        return []
    faults = []
    if len(problem.ground) != problem.height:
        message = f"{len(problem.ground)} rows on a grid {problem.height} high"
        faults.append(Fault("ground", message))
    for i, row in enumerate(problem.ground):
        if len(row) != problem.width:
            message = f"{len(row)} letters on a grid {problem.width} wide"
            faults.append(Fault(f"ground[{i}]", message))
    return faults


def _check_size(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    """Facts and actions are listed in memory: a small file must not make that immense."""
    count = Counter({kind: len(objects) for kind, objects in problem.objects.items()})
    for action in domain.action_defs:
        count.update(created.created_obj.type for created in _created(action.sfx))
    changing = fluents(domain)
    facts = sum(
        prod(count[kind] for kind in predicate.param_types)
        for predicate in domain.predicate_defs
        if predicate.name in changing
    )
    faults = []
    if facts > MAX_FACTS:
        message = f"{facts:,} possible facts; at most {MAX_FACTS:,} are allowed"
        faults.append(Fault("", f"too many objects: {message}"))
    predicates = {p.name: p for p in domain.predicate_defs}
    for action in domain.action_defs:
        choices = prod(count[kind] for kind in parameter_types(action, predicates).values())
        if choices > MAX_CHOICES:
            message = f"{action.name!r} could be done in {choices:,} ways; at most {MAX_CHOICES:,}"
            faults.append(Fault("", f"too many objects: {message} are allowed"))
    return faults
