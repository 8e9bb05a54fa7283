"""Assignments of objects to the goal's variables: all that could meet the goal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from robotouille.domain.schema import GoalTerm
from robotouille.planning.kitchen.compact_state import NONE, POT, CompactState, GoalSpec
from robotouille.planning.kitchen.model import KitchenModel

# Each assignment is a start node of its own. The general planner, which needs no assignment, takes
# goals with more choices.
MAX_ASSIGNMENTS = 4_000

Variable = int | str
Assignment = dict[Variable, int]
"""The number of an object or a meal for each variable that is not a station."""


class TooManyChoicesError(ValueError):
    """The goal has too many choices of objects for a search of each."""


@dataclass
class _Wants:
    """The goal's requirements for each variable."""

    processes: list[tuple[Variable, int]] = field(default_factory=list)
    lowest: dict[Variable, Variable] = field(default_factory=dict)
    there: list[tuple[Variable, Variable]] = field(default_factory=list)
    served: dict[Variable, Variable] = field(default_factory=dict)
    clear: list[Variable] = field(default_factory=list)
    atop: list[tuple[Variable, Variable]] = field(default_factory=list)
    added: list[tuple[Variable, Variable]] = field(default_factory=list)
    inside: list[tuple[Variable, Variable]] = field(default_factory=list)
    hot: list[Variable] = field(default_factory=list)


def goal_assignments(model: KitchenModel, start: CompactState) -> list[GoalSpec] | None:
    """Return the goals of a start, or None if compact states cannot express the goal.

    Raises:
        TooManyChoicesError: There are more than MAX_ASSIGNMENTS choices.
    """
    wants = _read(model)
    if wants is None:
        return None
    goals: list[GoalSpec] = []
    if _lacks_something(model):
        return goals
    # Objects that are alike at the start are interchangeable. Of assignments that differ only in
    # such objects, one is enough.
    for assignment in _assignments(model, start):
        if len(goals) == MAX_ASSIGNMENTS:
            raise TooManyChoicesError(f"more than {MAX_ASSIGNMENTS} choices of objects")
        goals.append(_goal(model, wants, assignment))
    return goals


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
    if _contradicts_itself(wants) or _is_served_in_a_pot(model, wants):
        return None
    placed = {*wants.lowest.values(), *(i for i, _ in wants.there), *(i for i, _ in wants.atop)}
    if not placed.issuperset(wants.clear):
        return None
    return None if wants.lowest.keys() & wants.served.keys() else wants


def _contradicts_itself(wants: _Wants) -> bool:
    """Return whether an object has to be in several places."""
    # The heuristic assumes one place for each object. Contradictory goals go to other planners,
    # which prove them unsolvable.
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


def _is_served_in_a_pot(model: KitchenModel, wants: _Wants) -> bool:
    """Return whether the goal may want a meal in a certain pot."""
    # The heuristic assumes that meals are poured into the container that the goal names.
    vessels = [o for _, variable in wants.inside for o in _candidates(model, variable)]
    return any(model.kitchen.container_kind[o] == POT for o in vessels)


def _lacks_something(model: KitchenModel) -> bool:
    """Return whether the goal needs a kind of objects that does not exist and cannot be made."""
    goal = model.world.goal
    return any(v.kind != "water" and not goal.candidates(v.id) for v in goal.variables.values())


def _stations(model: KitchenModel) -> list[Variable]:
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


def _assignments(model: KitchenModel, start: CompactState) -> Iterator[Assignment]:
    """Yield objects or meals for the variables that are not stations."""
    stations = set(_stations(model))
    variables = [v for v in model.world.goal.variables.values() if v.id not in stations]
    kinds = _kinds_of_alike(model, start)

    def extend(
        number: int, assignment: Assignment, taken: set[tuple[str, int]]
    ) -> Iterator[Assignment]:
        if number == len(variables):
            if _made_in_turn(model, taken):
                yield dict(assignment)
            return
        variable = variables[number]
        tried: set[object] = set()
        for o in _candidates(model, variable.id):
            sort = "meal" if variable.kind == "water" else "object"
            alike = (sort, kinds.get(o, o) if sort == "object" else o)
            if (sort, o) in taken or alike in tried:
                continue
            tried.add(alike)
            yield from extend(number + 1, {**assignment, variable.id: o}, taken | {(sort, o)})

    return extend(0, {}, set())


def _made_in_turn(model: KitchenModel, taken: set[tuple[str, int]]) -> bool:
    """Return whether the assigned meals that do not exist yet are the next ones to be made."""
    # New meals get the lowest free numbers, so an assignment with a gap waits for a meal in vain.
    unmade = sorted(o for sort, o in taken if sort == "meal" and o >= len(model.meals))
    return unmade == list(range(len(model.meals), len(model.meals) + len(unmade)))


def _candidates(model: KitchenModel, identifier: Variable) -> list[int]:
    """Return the objects or meals, also those to be made, that may stand for a variable."""
    variable = model.world.goal.variables[identifier]
    if variable.kind == "water":
        return list(range(model.kitchen.meals))
    names = set(model.world.goal.candidates(identifier))
    return [o for o, name in enumerate(model.objects) if name in names]


def _kinds_of_alike(model: KitchenModel, start: CompactState) -> dict[int, tuple[object, ...]]:
    """Return what distinguishes items that lie alone on plain tables."""
    kitchen = model.kitchen
    covered = set(start.below[: kitchen.items])
    found: dict[int, tuple[object, ...]] = {}
    for o in range(kitchen.items):
        if start.below[o] != kitchen.table_code or o in covered:
            continue
        processes = []
        for q in range(kitchen.processes):
            counters = [kitchen.progress[q][o], *kitchen.process_timer[q][o]]
            progress = [start.counters[c] if c != NONE else NONE for c in counters]
            facts = (kitchen.possible[q][o], kitchen.prerequisite[q][o], kitchen.total[q][o])
            processes.append((*facts, *progress))
        is_here = tuple(place == o for place in start.place)
        kind = model.world.thing(model.objects[o]).kind
        found[o] = (kind, is_here, *processes)
    return found


def _goal(model: KitchenModel, wants: _Wants, assignment: Assignment) -> GoalSpec:
    """Return the goal for one assignment."""
    kitchen = model.kitchen
    goal = GoalSpec(
        about=[0] * kitchen.objects,
        wanted_process=[[0] * kitchen.items for _ in range(kitchen.processes)],
        on_table=[0] * kitchen.objects,
        pile=[NONE] * kitchen.objects,
        clear=[0] * kitchen.objects,
        atop=[NONE] * kitchen.objects,
        added_to=[NONE] * kitchen.objects,
        wanted_meal=[0] * kitchen.meals,
        vessel=[NONE] * kitchen.meals,
        boiling=[0] * kitchen.meals,
    )
    for variable, o in assignment.items():
        if model.world.goal.variables[variable].kind == "water":
            goal.wanted_meal[o] = 1
        else:
            goal.about[o] = 1
    for variable, q in wants.processes:
        item = assignment[variable]
        goal.wanted_process[q][item] = 1
        if kitchen.prerequisite[q][item] != NONE:
            goal.wanted_process[kitchen.prerequisite[q][item]][item] = 1
    for variable in (*wants.lowest.values(), *wants.served.values()):
        goal.on_table[assignment[variable]] = 1
    for variable, station in wants.there:
        lowest = assignment[wants.lowest[station]]
        if assignment[variable] != lowest:
            goal.pile[assignment[variable]] = lowest
    for variable in wants.clear:
        goal.clear[assignment[variable]] = 1
    for upper, lower in wants.atop:
        goal.atop[assignment[upper]] = assignment[lower]
    for variable, meal in wants.added:
        goal.added_to[assignment[variable]] = assignment[meal]
    for meal, variable in wants.inside:
        goal.vessel[assignment[meal]] = assignment[variable]
    for meal in wants.hot:
        goal.boiling[assignment[meal]] = 1
    return goal
