"""Every choice of objects that could meet the goal, one row each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from robotouille.domain.schema import GoalTerm
from robotouille.planners.kitchen.compact_state import (
    ABLE,
    AFTER,
    BELOW,
    DONE,
    ITEMS,
    MEALS,
    OBJECTS,
    PLACE,
    PLAYERS,
    PROCESSES,
    ROLE,
    ROWS,
    STATIONS,
    TABLE,
    TIMER,
    TOTAL,
    laid_out,
)
from robotouille.planners.kitchen.kernels import Ints
from robotouille.planners.kitchen.model import KitchenModel

__all__ = ["TooManyChoicesError", "goals_of"]

MOST = 4_000
"""More choices than that are left to other planners."""

Choice = dict[int | str, int]


class TooManyChoicesError(ValueError):
    """There are more choices of objects than can be searched one by one."""


@dataclass
class _Wants:
    """What the goal says of each variable."""

    processes: list[tuple[int | str, int]] = field(default_factory=list)
    lowest: dict[int | str, int | str] = field(default_factory=dict)
    there: list[tuple[int | str, int | str]] = field(default_factory=list)
    served: dict[int | str, int | str] = field(default_factory=dict)
    clear: list[int | str] = field(default_factory=list)
    atop: list[tuple[int | str, int | str]] = field(default_factory=list)
    added: list[tuple[int | str, int | str]] = field(default_factory=list)
    inside: list[tuple[int | str, int | str]] = field(default_factory=list)
    hot: list[int | str] = field(default_factory=list)


def goals_of(model: KitchenModel, start: list[int]) -> Ints | None:
    """The rows for a start; None if the goal says something that a compact state does not.

    Objects that are alike at the start are interchangeable: of choices that differ only in them
    one is enough. Raises TooManyChoicesError.
    """
    wants = _read(model)
    if wants is None:
        return None
    rows: list[Choice] = []
    if _lacks_something(model):
        return _table(model, wants, rows)
    for choice in _choices(model, start):
        if len(rows) == MOST:
            raise TooManyChoicesError(f"more than {MOST} choices of objects")
        rows.append(choice)
    return _table(model, wants, rows)


def _read(model: KitchenModel) -> _Wants | None:
    goal, wants = model.world.goal, _Wants()
    for variable in goal.variables.values():
        if variable.is_type:
            return None
    for term in goal.terms:
        if not _note(model, term, wants):
            return None
    if any(station not in wants.lowest for _, station in wants.there):
        return None
    if _contradicts_itself(wants):
        return None
    placed = {*wants.lowest.values(), *(i for i, _ in wants.there), *(i for i, _ in wants.atop)}
    if not placed.issuperset(wants.clear):
        return None
    return None if wants.lowest.keys() & wants.served.keys() else wants


def _contradicts_itself(wants: _Wants) -> bool:
    """Whether something has to be in several places: that is for planners that try it."""
    lowest = list(wants.lowest.values())
    upper = [i for i, _ in wants.atop]
    added = [i for i, _ in wants.added]
    poured = [i for i, _ in wants.inside]
    there = dict(wants.there)
    elsewhere = [
        i for i, s in wants.there if there[i] != s or (i in lowest and wants.lowest[s] != i)
    ]
    somewhere = {*lowest, *upper, *there}
    several = any(len(set(ids)) != len(ids) for ids in (lowest, upper, added, poured))
    served = list(wants.served.values())
    twice = len(set(served)) != len(served)
    return bool(several or twice or elsewhere or somewhere & set(added) or set(lowest) & set(upper))


def _lacks_something(model: KitchenModel) -> bool:
    """Whether the goal is about objects of a kind of which there is none, nor will be."""
    goal = model.world.goal
    return any(v.kind != "water" and not goal.candidates(v.id) for v in goal.variables.values())


def _stations(model: KitchenModel) -> list[int | str]:
    goal = model.world.goal
    stations = {*model.tables, *model.stations}
    return [i for i in goal.variables if stations.issuperset(goal.candidates(i))]


def _note(model: KitchenModel, term: GoalTerm, wants: _Wants) -> bool:
    results = [p.result for p in model.rules.processes]
    ids = term.ids
    match term.predicate:
        case "item_on":
            if ids[1] in wants.lowest:
                return False
            wants.lowest[ids[1]] = ids[0]
        case "item_at":
            wants.there.append((ids[0], ids[1]))
        case "container_at":
            if ids[1] in wants.served:
                return False
            wants.served[ids[1]] = ids[0]
        case "clear":
            wants.clear.append(ids[0])
        case "atop":
            wants.atop.append((ids[0], ids[1]))
        case "addedto":
            wants.added.append((ids[0], ids[1]))
        case "in":
            wants.inside.append((ids[0], ids[1]))
        case "isboiling":
            wants.hot.append(ids[0])
        case "iswater":
            pass
        case predicate if predicate in results:
            wants.processes.append((ids[0], results.index(predicate)))
        case _:
            return False
    return True


def _choices(model: KitchenModel, start: list[int]) -> Iterator[Choice]:
    """Assignments of objects (or meals) to the variables that are not stations."""
    stations = set(_stations(model))
    variables = [v for v in model.world.goal.variables.values() if v.id not in stations]
    kinds = _kinds_of_alike(model, start)

    def extend(number: int, choice: Choice, taken: set[tuple[str, int]]) -> Iterator[Choice]:
        if number == len(variables):
            if _made_in_turn(model, taken):
                yield dict(choice)
            return
        variable = variables[number]
        tried: set[object] = set()
        for o in _candidates(model, variable.id, taken):
            sort = "meal" if variable.kind == "water" else "object"
            alike = (sort, kinds.get(o, o) if sort == "object" else o)
            if (sort, o) in taken or alike in tried:
                continue
            tried.add(alike)
            yield from extend(number + 1, {**choice, variable.id: o}, taken | {(sort, o)})

    return extend(0, {}, set())


def _made_in_turn(model: KitchenModel, taken: set[tuple[str, int]]) -> bool:
    """Whether of the meals yet to be made the first ones are chosen."""
    unmade = sorted(o for sort, o in taken if sort == "meal" and o >= len(model.meals))
    return unmade == list(range(len(model.meals), len(model.meals) + len(unmade)))


def _candidates(
    model: KitchenModel, identifier: int | str, taken: set[tuple[str, int]]
) -> list[int]:
    """The objects that may stand for a variable; of meals yet to be made, those in turn."""
    variable = model.world.goal.variables[identifier]
    if variable.kind == "water":
        return list(range(model.kitchen[MEALS]))
    names = set(model.world.goal.candidates(identifier))
    return [o for o, name in enumerate(model.objects) if name in names]


def _kinds_of_alike(model: KitchenModel, start: list[int]) -> dict[int, tuple[object, ...]]:
    """Items that lie alone on plain tables, by what there is to tell them apart."""
    k = model.kitchen
    covered = {start[k[BELOW] + o] for o in range(k[ITEMS])}
    found: dict[int, tuple[object, ...]] = {}
    for o in range(k[ITEMS]):
        if start[k[BELOW] + o] != k[TABLE] or o in covered:
            continue
        counters = []
        for q in range(k[PROCESSES]):
            at = q * k[ITEMS] + o
            slots = [k[k[DONE] + at]] + [
                k[k[TIMER] + at * k[STATIONS] + i] for i in range(k[STATIONS])
            ]
            facts = (k[k[ABLE] + at], k[k[AFTER] + at], k[k[TOTAL] + at])
            counters.append((*facts, *(start[slot] if slot >= 0 else -1 for slot in slots)))
        here = tuple(start[k[PLACE] + p] == o for p in range(k[PLAYERS]))
        kind = model.world.thing(model.objects[o]).kind
        found[o] = (kind, here, *counters)
    return found


def _table(model: KitchenModel, wants: _Wants, rows: list[Choice]) -> Ints:
    k = model.kitchen
    role, base, pile, top, atop, into = ([0] * (len(rows) * k[OBJECTS]) for _ in range(6))
    need = [0] * (len(rows) * k[PROCESSES] * k[ITEMS])
    wanted, vessel, hot = ([0] * (len(rows) * k[MEALS]) for _ in range(3))
    meals = {v.id for v in model.world.goal.variables.values() if v.kind == "water"}
    for r, choice in enumerate(rows):
        for variable, o in choice.items():
            if variable in meals:
                wanted[r * k[MEALS] + o] = 1
            else:
                role[r * k[OBJECTS] + o] = 1
        for variable, q in wants.processes:
            first = k[k[AFTER] + q * k[ITEMS] + choice[variable]] - 1
            for needed in (q, first) if first >= 0 else (q,):
                need[(r * k[PROCESSES] + needed) * k[ITEMS] + choice[variable]] = 1
        for variable in (*wants.lowest.values(), *wants.served.values()):
            base[r * k[OBJECTS] + choice[variable]] = 1
        for variable, station in wants.there:
            lowest = choice[wants.lowest[station]]
            if choice[variable] != lowest:
                pile[r * k[OBJECTS] + choice[variable]] = lowest + 1
        for variable in wants.clear:
            top[r * k[OBJECTS] + choice[variable]] = 1
        for upper, lower in wants.atop:
            atop[r * k[OBJECTS] + choice[upper]] = choice[lower] + 1
        for variable, meal in wants.added:
            into[r * k[OBJECTS] + choice[variable]] = choice[meal] + 1
        for meal, variable in wants.inside:
            vessel[r * k[MEALS] + choice[meal]] = choice[variable] + 1
        for meal in wants.hot:
            hot[r * k[MEALS] + choice[meal]] = 1
    tables = dict(enumerate((role, need, base, pile, top, atop, into, wanted, vessel, hot), ROLE))
    return laid_out({ROWS: len(rows)}, tables)
