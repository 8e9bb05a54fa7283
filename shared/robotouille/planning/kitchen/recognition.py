"""Recognition of kitchens: domains whose actions do what `transitions` does.

Actions are compared as normalised sentences. A *process* is any action of a player with free hands
on a clear item at a station of some kind. It is either repeated until it takes effect, or performed
once. Then it takes effect after a delay during which the item has to stay at the station.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from robotouille.domain.schema import (
    ActionDef,
    Condition,
    Conditional,
    Creation,
    DomainFile,
    EffectDef,
)

# A sentence mentions every precondition and effect, sorted. So a domain with one more condition is
# left to the general planner, whose plans are right for any domain.
FIXED = {
    "loc(p1,s1); vacant(s2) -> loc(p1,s2); not loc(p1,s1); not vacant(s2); vacant(s1)": "move",
    "clear(i1); item_on(i1,s1); loc(p1,s1); nothing(p1) -> has_item(p1,i1); not clear(i1); "
    "not item_at(i1,s1); not item_on(i1,s1); not nothing(p1); station_empty(s1)": "pick item",
    "has_item(p1,i1); loc(p1,s1); station_empty(s1) -> clear(i1); item_at(i1,s1); "
    "item_on(i1,s1); not has_item(p1,i1); not station_empty(s1); nothing(p1)": "place item",
    "clear(i2); has_item(p1,i1); item_at(i2,s1); loc(p1,s1) -> atop(i1,i2); clear(i1); "
    "item_at(i1,s1); not clear(i2); not has_item(p1,i1); nothing(p1)": "stack",
    "atop(i1,i2); clear(i1); item_at(i1,s1); item_at(i2,s1); loc(p1,s1); nothing(p1) -> "
    "clear(i2); has_item(p1,i1); not atop(i1,i2); not clear(i1); not item_at(i1,s1); "
    "not nothing(p1)": "unstack",
    "container_at(c1,s1); loc(p1,s1); nothing(p1) -> has_container(p1,c1); "
    "not container_at(c1,s1); not nothing(p1); station_empty(s1)": "pick container",
    "has_container(p1,c1); loc(p1,s1); station_empty(s1) -> container_at(c1,s1); "
    "not has_container(p1,c1); not station_empty(s1); nothing(p1)": "place container",
    "container_at(c1,s1); container_empty(c1); ispot(c1); issink(s1); loc(p1,s1); nothing(p1) -> "
    "| conditional c1 if container_at(c1,s1) {} [delayed c1 {} [creation c1 water meal m1 "
    "{in(m1,c1); iswater(m1); not container_empty(c1)}]]": "fill",
    "container_at(c1,s1); in(m1,c1); ispot(c1); isstove(s1); iswater(m1); loc(p1,s1); "
    "nothing(p1) -> | conditional m1 if container_at(c1,s1) {} [delayed m1 "
    "{isboiling(m1)}]": "boil",
    "container_at(c1,s1); has_item(p1,i1); in(m1,c1); ispot(c1); loc(p1,s1); "
    "not addedto(i1,m1) -> addedto(i1,m1); not has_item(p1,i1); nothing(p1)": "add",
    "container_at(c1,s1); container_empty(c1); has_container(p1,c2); in(m1,c2); isbowl(c1); "
    "ispot(c2); loc(p1,s1) -> container_empty(c2); in(m1,c1); not container_empty(c1); "
    "not in(m1,c2)": "pour",
    "->": "wait",
}

_FIXED_FACTS = frozenset(re.findall(r"([\w-]+)\(", " ".join(FIXED)))

_NAME = r"([\w-]+)"
_BEFORE = ["clear(i1)", "item_on(i1,s1)", "loc(p1,s1)", "nothing(p1)"]
_REPEATED = re.compile(rf"repetitive i1 {{{_NAME}\(i1\)}}")
_TIMED = re.compile(
    rf"conditional i1 if item_on\(i1,s1\) {{(?:{_NAME}\(i1\))?}} "
    rf"\[delayed i1 {{{_NAME}\(i1\)(?:; not {_NAME}\(i1\))?}}\]"
)
_ENABLING = re.compile(rf"conditional i1 if {_NAME}\(i1\); {_NAME}\(i1\) {{{_NAME}\(i1\)}}")


@dataclass(frozen=True, slots=True)
class Process:
    """Work on an item: at stations with the fact `station`, on items with the fact `requires`.

    `enables` contains pairs: when the process is done, an item with the first fact gets the second.
    `forbidden` facts of the item prevent the process; it may set them while it runs.
    """

    action: str
    station: str
    requires: str
    result: str
    timed: bool
    enables: tuple[tuple[str, str], ...] = ()
    forbidden: frozenset[str] = frozenset()


@dataclass
class KitchenRules:
    """The names of a kitchen's actions by meaning, and its processes."""

    actions: dict[str, str] = field(default_factory=dict)
    processes: list[Process] = field(default_factory=list)


def recognise(domain: DomainFile) -> KitchenRules | None:
    """Return the rules of a domain that is a kitchen while all stations can be reached, or None."""
    rules = KitchenRules()
    reaches = frozenset(r.predicate for r in domain.layout or () if r.when == "reaches")
    for action in domain.action_defs:
        meaning = FIXED.get(_sentence(action, reaches))
        if meaning is not None:
            rules.actions.setdefault(meaning, action.name)
            continue
        process = _process(action)
        if process is None:
            return None
        rules.processes.append(process)
    if not _are_simple(rules.processes):
        return None
    # Filling, boiling, adding and pouring are optional: kitchens without soup lack them.
    needed = {"move", "pick item", "place item", "stack", "unstack"}
    flags = [p.station for p in rules.processes]
    if not needed <= rules.actions.keys() or len(set(flags)) != len(flags):
        return None
    return rules


def _are_simple(processes: list[Process]) -> bool:
    """Return whether a `Kitchen` can express how the processes depend on each other."""
    # `Kitchen.prerequisite` has one entry per process and item, and no entry has another one: each
    # process has its own result, and at most one other process enables it.
    results = [p.result for p in processes]
    gained = [fact for p in processes for fact in {fact for _, fact in p.enables}]
    if len(set(results)) != len(results) or len(set(gained)) != len(gained):
        return False
    chained = any(p.requires in gained and p.enables for p in processes)
    return not chained and _facts_are_apart(processes, {*results}, {*gained})


def _facts_are_apart(processes: list[Process], results: set[str], gained: set[str]) -> bool:
    """Return whether no process changes a fact that has another meaning for a kitchen."""
    # A compact state has no room for facts that hold for a while, and does not derive one process
    # from another except as a prerequisite.
    forbidden = [fact for p in processes for fact in p.forbidden]
    changed = [*results, *gained, *forbidden]
    conditions = {fact for p in processes for fact, _ in p.enables}
    required = {p.requires for p in processes}
    if len({*changed}) != len(changed) or conditions.intersection(changed):
        return False
    return not (_FIXED_FACTS | required - gained).intersection(changed)


def _sentence(action: ActionDef, without: frozenset[str]) -> str:
    before = _conditions(c for c in action.precons if c.predicate not in without)
    text = f"{before} -> {_conditions(action.immediate_fx)}"
    if action.sfx:
        text += "| " + ", ".join(map(_effect, action.sfx))
    return text.strip()


def _conditions(conditions: Iterable[Condition]) -> str:
    return "; ".join(sorted(_condition(c) for c in conditions))


def _condition(condition: Condition) -> str:
    atom = f"{condition.predicate}({','.join(condition.params)})"
    return atom if condition.is_true else f"not {atom}"


def _effect(effect: EffectDef) -> str:
    text = f"{effect.type} {effect.param}"
    if isinstance(effect, Conditional):
        text += f" if {_conditions(effect.conditions)}"
    if isinstance(effect, Creation):
        created = effect.created_obj
        text += f" {created.name} {created.type} {created.param}"
    text += f" {{{_conditions(effect.fx)}}}"
    if effect.sfx:
        text += f" [{', '.join(map(_effect, effect.sfx))}]"
    return text


def _process(action: ActionDef) -> Process | None:
    before = {_condition(c) for c in action.precons}
    if not before.issuperset(_BEFORE) or action.immediate_fx or not action.sfx:
        return None
    rest = sorted(before.difference(_BEFORE))
    forbidden = [c[4:-4] for c in rest if c.startswith("not ") and c.endswith("(i1)")]
    requires = [c[:-4] for c in rest if c.endswith("(i1)") and not c.startswith("not ")]
    stations = [c[:-4] for c in rest if c.endswith("(s1)") and not c.startswith("not ")]
    if len(requires) != 1 or len(stations) != 1 or len(rest) != 2 + len(forbidden):
        return None
    first, *others = map(_effect, action.sfx)
    enables = [_ENABLING.fullmatch(text) for text in others]
    repeated, timed = _REPEATED.fullmatch(first), _TIMED.fullmatch(first)
    result = repeated[1] if repeated else timed[2] if timed else ""
    meanwhile = frozenset({timed[1], timed[3]} - {None} if timed else ())
    if not result or set(forbidden) != meanwhile:
        return None
    pairs = []
    for match in enables:
        if match is None or result not in (match[1], match[2]):
            return None
        pairs.append((match[1] if match[2] == result else match[2], match[3]))
    return Process(
        action.name, stations[0], requires[0], result, timed is not None, tuple(pairs), meanwhile
    )
