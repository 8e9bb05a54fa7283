"""Plans for shifts: each dish is a task of its own, which all planners can plan."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from threading import Lock, Thread

from robotouille.domain.schema import Condition, DomainFile, GoalTerm
from robotouille.domain.task import Task
from robotouille.errors import RobotouilleError
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.shift import ShiftRules
from robotouille.world.world import World

CHOICES = 6
"""Choices of objects that plans next to other participants try: they may block the first one."""

_LOCATING = ("shares_tile", "bottom_of_stack")
"""Layout rules of the predicates that say on which station a thing is."""


class DishPlanner:
    """One dish of a shift as a task whose goal is the dish, with its anytime planner.

    The objects and facts are those of the shift, so `anytime` plans from states of the shift.
    """

    def __init__(self, world: World, dish: str) -> None:
        goal = rules_of(world).menu[dish].goal
        if not world.is_undivided:
            goal = _with_stations(goal, world)
        task = world.task
        problem = task.problem.model_copy(update={"shift": None, "goal": goal})
        name, domain = f"{task.name}: {dish}", _taking_nothing_back(task)
        self.world = World(replace(task, name=name, domain=domain, problem=problem))
        self._lock = Lock()

    @property
    def anytime(self) -> AnytimePlanner:
        """The planner of the dish, which analyses the kitchen once."""
        with self._lock:
            return self._planner

    @cached_property
    def _planner(self) -> AnytimePlanner:
        return self.new_planner()

    def new_planner(self) -> AnytimePlanner:
        """Return a planner that has analysed nothing yet."""
        return AnytimePlanner(self.world)

    def prepare(self) -> None:
        """Analyse the kitchen. In another thread, `anytime` waits for the end.

        The analysis takes some seconds, which the first plan for the dish would take otherwise.
        """
        with self._lock:
            start, first = self.world.initial, self.world.players[:1]
            self._planner.is_cut_off(start, first)
            next(self._planner.search(start, team=first, beam=1, choices=CHOICES, brief=True))


def prepare_in_background(dishes: Iterable[DishPlanner]) -> Thread:
    """Start and return a thread that prepares dishes, one after the other."""

    def prepare() -> None:
        for dish in dishes:
            dish.prepare()

    thread = Thread(target=prepare, daemon=True)
    thread.start()
    return thread


def _taking_nothing_back(task: Task) -> DomainFile:
    """Return the domain of a shift without actions that take things from a station for discarding.

    Without the rules of a shift, such a station would be a place to keep things. There they vanish.
    """
    domain, shift = task.domain, task.problem.shift
    flag = None if shift is None or shift.discard is None else f"is{shift.discard}"
    types = {p.name: p.param_types for p in domain.predicate_defs}
    if flag not in types:
        return domain
    located = {rule.predicate for rule in domain.layout or () if rule.when in _LOCATING}
    actions = []
    for action in domain.action_defs:
        stations = {
            fx.params[-1]
            for fx in action.immediate_fx
            if not fx.is_true
            and fx.predicate in located
            and types[fx.predicate][-1:] == types[flag]
        }
        never = [Condition(predicate=flag, params=(s,), is_true=False) for s in sorted(stations)]
        actions.append(action.model_copy(update={"precons": (*action.precons, *never)}))
    return domain.model_copy(update={"action_defs": tuple(actions)})


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
