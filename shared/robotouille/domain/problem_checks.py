"""Checks of a problem's cross-references, which a schema cannot express.

Functions return all faults that they find and never raise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from math import prod

from robotouille.domain.derived import (
    created_by,
    domain_kinds,
    effects_of,
    fluents,
    parameter_types,
)
from robotouille.domain.domain_checks import unknown
from robotouille.domain.schema import (
    MAX_ORDERS,
    ActionDef,
    Arrivals,
    CountedEffect,
    DomainFile,
    GoalTerm,
    LayoutRule,
    ObjectDef,
    PredicateDef,
    ProblemFile,
)
from robotouille.errors import Fault, bounded, did_you_mean, with_article

MAX_FACTS = 20_000
"""Limit on a task's fluent facts, and on the initial facts that its layout rules imply.

Small files can otherwise claim gigabytes. Shipped tasks have up to 160 initial facts."""
MAX_GROUND_CONDITIONS = 6_000_000
"""Limit on the preconditions and effects of all instances of actions; shipped tasks have up to
420,000."""
MAX_CHOICES = 500_000
"""Limit on the instances of a task's actions.

Making all of them at the limit takes 16 seconds. Shipped tasks have up to 41,000, and a shift with
fifty ingredients and four seats 400,000."""
MAX_MASK_BYTES = 768 * 1024 * 1024
"""Limit on the memory of the masks of all instances of actions and of their special effects.

The limits above allow 500,000 actions whose masks have 20,000 bits each, which take gigabytes.
Shipped tasks have up to 36 MiB, and a shift with fifty ingredients and four seats 691 MiB."""
_MASK_HEAD = 32
"""Bytes of a mask besides its bits."""


@bounded
def check_problem(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    """Find objects off the grid or of unknown types, unknown predicates, and invalid goals."""
    return [
        *_check_objects(problem, domain),
        *_check_goal("goal", problem.goal, problem, domain),
        *_check_shift(problem, domain),
        *_check_config(problem, domain),
        *_check_ground(problem),
        *_check_size(problem, domain),
    ]


def _check_objects(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    faults = []
    predicates = {p.name: p for p in domain.predicate_defs}
    ids: set[str | int] = set()
    for kind, objects in problem.objects.items():
        if kind not in domain.object_types:
            faults.append(unknown(object_place(kind), "object type", kind, domain.object_types))
        for i, obj in enumerate(objects):
            path = object_place(kind, i)
            if obj.x >= problem.width or obj.y >= problem.height:
                size = f"{problem.width} by {problem.height}"
                faults.append(Fault(path, f"({obj.x}, {obj.y}) is off the {size} grid"))
            for j, name in enumerate(obj.predicates):
                where = f"{path}.predicates[{j}]"
                if name not in predicates:
                    faults.append(unknown(where, "predicate", name, predicates))
                elif predicates[name].param_types != (kind,):
                    faults.append(Fault(where, f"{name!r} does not describe a single {kind}"))
            if obj.id is not None:
                if obj.id in ids:
                    faults.append(Fault(f"{path}.id", f"the id {obj.id!r} is used twice"))
                ids.add(obj.id)
    if not any(problem.objects.get(kind) for kind in domain.player_types):
        faults.append(Fault("", f"has no {' or '.join(domain.player_types)}"))
    return [
        *faults,
        *_check_names(problem),
        *_check_seats(problem, domain),
    ]


@bounded
def check_kinds(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    """Find kinds that neither the domain nor a predicate mentions, if the domain lists kinds.

    A problem can have items and containers of its own, so those are only warnings. A task with an
    unknown station loads, because recordings may have one.
    """
    faults = []
    known = {kind for kind, of in domain_kinds(domain).items() if of != kind}
    for type_, objects in problem.objects.items():
        listed = domain.kinds.get(type_, ())
        for i, obj in enumerate(objects):
            if listed and not obj.predicates and obj.name not in (type_, *listed, *known):
                station = type_ in domain.station_types
                near = did_you_mean(obj.name, listed)
                if station and not near:
                    near = f": add it to the domain's 'kinds.{type_}'"
                message = f"unknown {type_} kind {obj.name!r}{near}"
                severity = "error" if station else "warning"
                faults.append(Fault(f"{object_place(type_, i)}.name", message, severity))
    return faults


def _check_names(problem: ProblemFile) -> list[Fault]:
    """Find kinds whose numbered objects share a name, as object 1 of `leek1` and 11 of `leek`."""
    owners: dict[str, tuple[str, str]] = {}
    clashes: dict[tuple[str, str], Fault] = {}
    for type_, objects in problem.objects.items():
        for kind, count in Counter(obj.name for obj in objects).items():
            for number in range(1, count + 1):
                other = owners.setdefault(f"{kind}{number}", (type_, kind))
                if other != (type_, kind):
                    name = f"{kind}{number}"
                    message = f"{kind!r} and the {other[0]} {other[1]!r} both have an object {name}"
                    clashes.setdefault((type_, kind), Fault(object_place(type_), message))
    return list(clashes.values())


def _check_seats(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    players = sum(len(problem.objects.get(kind, ())) for kind in domain.player_types)
    return [
        Fault(f"seats[{i}]", f"{count} seats, but the problem lists {players} players")
        for i, count in enumerate(problem.seats or ())
        if count > players
    ]


def _check_goal(
    name: str, terms: Iterable[GoalTerm], problem: ProblemFile, domain: DomainFile
) -> list[Fault]:
    faults = []
    predicates = {p.name: p for p in domain.predicate_defs}
    kinds = _kinds(problem, domain)
    ids = {
        o.id: kind for kind, objects in problem.objects.items() for o in objects if o.id is not None
    }
    first: dict[int | str, str] = {}
    for i, term in enumerate(terms):
        path = f"{name}[{i}]"
        definition = predicates.get(term.predicate)
        if definition is None:
            faults.append(unknown(f"{path}.predicate", "predicate", term.predicate, predicates))
            continue
        if len(term.args) != len(definition.param_types):
            expected = len(definition.param_types)
            message = f"{term.predicate!r} takes {expected}, found {len(term.args)}"
            faults.append(Fault(f"{path}.args", message))
            continue
        for j, (kind, wanted) in enumerate(zip(term.args, definition.param_types, strict=True)):
            where = f"{path}.args[{j}]"
            if kind not in kinds:
                faults.append(unknown(where, "kind of object", kind, kinds))
            elif kinds[kind] != wanted:
                is_one, needed = with_article(kinds[kind]), with_article(wanted)
                message = f"{kind!r} is {is_one}, {term.predicate!r} needs {needed}"
                faults.append(Fault(where, message))
            identifier = term.ids[j]
            if isinstance(identifier, str) and identifier not in ids:
                message = f"no object has the id {identifier!r}"
                message += did_you_mean(identifier, (str(x) for x in ids))
                faults.append(Fault(f"{path}.ids[{j}]", message))
            known = first.setdefault(identifier, kind)
            found = ids.get(identifier) if isinstance(identifier, str) else kinds.get(known)
            if kind in kinds and found not in (None, kinds[kind]):
                one, other = with_article(found), with_article(kinds[kind])
                message = f"the object {identifier!r} is {one}, {kind!r} is {other}"
                faults.append(Fault(f"{path}.ids[{j}]", message))
            elif known != kind:
                message = (
                    f"the object {identifier!r} is {known!r} in an earlier term and {kind!r} here"
                )
                faults.append(Fault(where, f"{message}; the earlier kind is used", "warning"))
    return faults


def _check_shift(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    shift = problem.shift
    if shift is None:
        return []
    faults = []
    for name, dish in shift.menu.items():
        faults += _check_goal(f"shift.menu[{name!r}].goal", dish.goal, problem, domain)
    if not isinstance(shift.arrivals, Arrivals):
        faults += [
            unknown(f"shift.arrivals[{i}].dish", "dish", arrival.dish, shift.menu)
            for i, arrival in enumerate(shift.arrivals)
            if arrival.dish not in shift.menu
        ]
        if len(shift.arrivals) > MAX_ORDERS:
            message = f"{len(shift.arrivals):,} orders; at most {MAX_ORDERS:,} are allowed"
            faults.append(Fault("shift.arrivals", message))
        times = [arrival.at for arrival in shift.arrivals]
        if times != sorted(times):
            faults.append(Fault("shift.arrivals", "the orders are not sorted by their times"))
    predicates = {p.name: p for p in domain.predicate_defs}
    for i, predicate in enumerate(shift.serve.predicates):
        path = f"shift.serve.predicates[{i}]"
        if predicate not in predicates:
            faults.append(unknown(path, "predicate", predicate, predicates))
        elif not _relates_to_station(predicates[predicate], domain):
            message = f"{predicate!r} does not relate a thing to a station"
            faults.append(Fault(path, message))
    for i, predicate in enumerate(shift.serve.soils):
        path = f"shift.serve.soils[{i}]"
        if predicate not in predicates:
            faults.append(unknown(path, "predicate", predicate, predicates))
        elif len(predicates[predicate].param_types) != 1:
            faults.append(Fault(path, f"{predicate!r} does not describe a single thing"))
    faults += _check_places(problem, domain)
    if shift.discard == shift.serve.station:
        faults.append(Fault("shift.discard", "dishes are served at these stations"))
    stations = {o.name for kind in domain.station_types for o in problem.objects.get(kind, ())}
    for path, station in (("serve.station", shift.serve.station), ("discard", shift.discard)):
        if station is not None and station not in stations:
            message = f"the kitchen has no station {station!r}{did_you_mean(station, stations)}"
            faults.append(Fault(f"shift.{path}", message))
    return faults


def _check_places(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    """Find things that do not begin on a station, to which they return in a shift."""
    fixed = {*domain.station_types, *domain.player_types}
    tiles = {(o.x, o.y) for kind in domain.station_types for o in problem.objects.get(kind, ())}
    return [
        Fault(object_place(kind, i), f"{obj.name!r} is not on a station, as a shift requires")
        for kind, objects in problem.objects.items()
        if kind not in fixed
        for i, obj in enumerate(objects)
        if (obj.x, obj.y) not in tiles
    ]


def _relates_to_station(predicate: PredicateDef, domain: DomainFile) -> bool:
    types = predicate.param_types
    movable = {*domain.object_types} - {*domain.station_types, *domain.player_types}
    return len(types) == 2 and types[0] in movable and types[1] in domain.station_types


def _kinds(problem: ProblemFile, domain: DomainFile) -> dict[str, str]:
    kinds = domain_kinds(domain)
    for kind, objects in problem.objects.items():
        kinds.update({obj.name: kind for obj in objects})
    return kinds


def _check_config(problem: ProblemFile, domain: DomainFile) -> list[Fault]:
    keys = {
        effect.config
        for action in domain.action_defs
        for _, effect in effects_of("", action.sfx)
        if isinstance(effect, CountedEffect) and effect.config is not None
    }
    return [
        unknown(f"config.{key}", "configuration key", key, sorted(keys))
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
    """Find problems with so many facts or actions that listing them would fill the memory."""
    count = Counter({kind: len(objects) for kind, objects in problem.objects.items()})
    for action in domain.action_defs:
        count.update(created.created_obj.type for created in created_by(action.sfx))
    changing = fluents(domain)
    facts = sum(
        prod(count[kind] for kind in predicate.param_types)
        for predicate in domain.predicate_defs
        if predicate.name in changing
    )
    faults = []
    own = sum(len(thing.predicates) for objects in problem.objects.values() for thing in objects)
    if own > MAX_FACTS:
        message = f"{own:,} predicates of objects; at most {MAX_FACTS:,} are allowed"
        faults.append(Fault("", f"too many objects: {message}"))
    if facts > MAX_FACTS:
        message = f"{facts:,} possible facts; at most {MAX_FACTS:,} are allowed"
        faults.append(Fault("", f"too many objects: {message}"))
    implied = sum(_implied_facts(rule, problem, domain) for rule in domain.layout or ())
    if implied > MAX_FACTS:
        message = f"the domain's layout implies {implied:,} initial facts; at most {MAX_FACTS:,}"
        faults.append(Fault("", f"too many objects: {message} are allowed"))
    predicates = {p.name: p for p in domain.predicate_defs}
    choices = {
        action.name: prod(count[kind] for kind in parameter_types(action, predicates).values())
        for action in domain.action_defs
    }
    conditions = sum(
        choices[action.name] * (len(action.precons) + len(action.immediate_fx))
        for action in domain.action_defs
    )
    if conditions > MAX_GROUND_CONDITIONS:
        message = f"the actions have {conditions:,} conditions; at most {MAX_GROUND_CONDITIONS:,}"
        faults.append(Fault("", f"too many objects: {message} are allowed"))
    if sum(choices.values()) > MAX_CHOICES:
        most = max(choices, key=choices.__getitem__)
        message = (
            f"the actions have {sum(choices.values()):,} possible arguments, "
            f"{most!r} alone {choices[most]:,}; at most {MAX_CHOICES:,} are allowed"
        )
        faults.append(Fault("", f"too many objects: {message}"))
    masks = sum(choices[action.name] * _masks_of(action) for action in domain.action_defs)
    size = masks * (_MASK_HEAD + facts // 8)
    if not faults and size > MAX_MASK_BYTES:
        message = f"the actions can take {size / 2**20:,.0f} MiB; at most {MAX_MASK_BYTES >> 20:,}"
        faults.append(Fault("", f"too many objects: {message} MiB are allowed"))
    return faults


def _masks_of(action: ActionDef) -> int:
    """Return the number of masks of an action's instance; see `world/grounding`."""
    effects = sum(1 for _ in effects_of("", action.sfx))
    # An action and each node of an effect have masks for what they test, require, set and clear.
    # An action with effects and each effect also have one for all that the effect reads.
    return 4 * (1 + effects) + (1 + len(action.sfx) if action.sfx else 0)


def _implied_facts(rule: LayoutRule, problem: ProblemFile, domain: DomainFile) -> int:
    """Return the most facts that a rule implies, without making them."""
    types = next((p.param_types for p in domain.predicate_defs if p.name == rule.predicate), ())
    lists = [problem.objects.get(kind, ()) for kind in types]
    if rule.when == "reaches":
        stations = sum(len(problem.objects.get(kind, ())) for kind in domain.station_types)
        return len(lists[0]) * stations if lists else 0
    if rule.when is None or not lists:
        return sum(map(len, lists))
    if rule.when == "faces":
        first = Counter(_tile_ahead(o) for o in lists[0])
    else:
        first = Counter((o.x, o.y) for o in lists[0])
    if rule.when in ("faces", "shares_tile"):
        others: Iterable[ObjectDef] = lists[-1]
    else:
        others = (o for kind in domain.station_types for o in problem.objects.get(kind, ()))
    second = Counter((o.x, o.y) for o in others)
    return sum(number * second[tile] for tile, number in first.items())


def _tile_ahead(thing: ObjectDef) -> tuple[int, int]:
    dx, dy = thing.direction or (0, 0)
    return thing.x + dx, thing.y + dy


def object_place(kind: str, index: int | None = None) -> str:
    """Return the place of a type's objects, or of one of them, in a problem."""
    return f"objects.{kind}" if index is None else f"objects.{kind}[{index}]"
