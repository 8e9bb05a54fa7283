"""Plans for shifts: each dish is a task of its own, which all planners can plan."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from robotouille.domain.schema import GoalTerm
from robotouille.errors import RobotouilleError
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.shift import ShiftRules
from robotouille.world.world import World


class DishPlanner:
    """One dish of a shift as a task whose goal is the dish, with its anytime planner.

    The objects and facts are those of the shift, so `anytime` plans from states of the shift.
    """

    def __init__(self, world: World, dish: str) -> None:
        goal = rules_of(world).menu[dish].goal
        if not world.is_undivided:
            goal = _with_stations(goal, world)
        problem = world.task.problem.model_copy(update={"shift": None, "goal": goal})
        self.world = World(replace(world.task, name=f"{world.task.name}: {dish}", problem=problem))

    @cached_property
    def anytime(self) -> AnytimePlanner:
        """The planner of the dish, which analyses the kitchen once."""
        return AnytimePlanner(self.world)


def _with_stations(goal: tuple[GoalTerm, ...], world: World) -> tuple[GoalTerm, ...]:
    """Add to a dish that all of its stack is on the station of its lowest part.

    This follows from the rules. It tells planners early to which side of a divided kitchen each
    part has to go. Elsewhere they find shorter plans without it.
    """
    domain = world.task.domain
    when = {rule.predicate: rule.when for rule in domain.layout or () if rule.when}
    types = {p.name: p.param_types for p in domain.predicate_defs}
    kinds = {id_: kind for term in goal for id_, kind in zip(term.ids, term.args, strict=True)}
    where = {t.ids[0]: t.ids[1] for t in goal if when.get(t.predicate) == "bottom_of_stack"}
    found = list(goal)
    stacked = [t for t in goal if when.get(t.predicate) == "next_in_stack"]
    while above := [t for t in stacked if t.ids[1] in where and t.ids[0] not in where]:
        for term in above:
            thing, station = term.ids[0], where[term.ids[1]]
            where[thing] = station
            wanted = (types[term.predicate][0], domain.station_types[0])
            found += [
                GoalTerm(predicate=name, args=(kinds[thing], kinds[station]), ids=(thing, station))
                for name, rule in when.items()
                if rule == "shares_tile" and types[name] == wanted
            ]
    return tuple(found)


def rules_of(world: World) -> ShiftRules:
    """Return the rules of a world's shift.

    Raises:
        RobotouilleError: The task has no shift.
    """
    if world.shift is None:
        raise RobotouilleError(f"{world.task.name} has no shift")
    return world.shift
