"""Instances of shifts: another kitchen, a part of the menu and other orders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, pairwise
from math import ceil

from robotouille.domain.schema import MAX_ORDERS, Arrival, Shift
from robotouille.domain.task import Task
from robotouille.generation.arrangement import Arrangement, arrange
from robotouille.generation.generator import ATTEMPTS, Generator, Solver, shortest
from robotouille.generation.instance import Instance, seat_counts, with_planner_points
from robotouille.generation.parameters import (
    DEFAULT,
    AttemptError,
    GenerationError,
    Kind,
    Parameters,
    SeededRng,
)
from robotouille.planning.plan import Proof, SearchResult
from robotouille.planning.policies.shift_policy import play_shift
from robotouille.world.lint import lint_task

# The shipped shifts have stars from simulated people, whose games take minutes each. These are the
# medians of their shares.
STARS = (0.25, 0.48, 0.6)
"""Points for one, two and three stars, as shares of the points of planner bots."""


def generate(
    task: Task,
    seed: int,
    kind: Kind = Kind.FREE,
    parameters: Parameters = DEFAULT,
    *,
    solver: Solver = shortest,
) -> Instance:
    """Return an instance of a task, proven solvable for all its numbers of players.

    Raises:
        GenerationError: There is no such instance; `parameter` names the option to change.
        FileError: The task has faults.
        PluginError: The default solver cannot load an installed plug-in.
    """
    return generator_of(task, kind, parameters, solver=solver).instance(seed)


def generator_of(
    task: Task,
    kind: Kind = Kind.FREE,
    parameters: Parameters = DEFAULT,
    *,
    solver: Solver = shortest,
    attempts: int = ATTEMPTS,
) -> Generator:
    """Return the generator for a task with a goal or a shift.

    Raises:
        GenerationError: The parameters contradict the task or the kind of instance.
        FileError: The task has faults.
    """
    make = Generator if task.problem.shift is None else ShiftGenerator
    return make(task, kind, parameters, solver=solver, attempts=attempts)


class ShiftGenerator(Generator):
    """Generator of the instances of one shift.

    Stations move together with the things on them, because things return there. Planner bots serve
    at least one order with every number of players. The solver is not used.

    Raises:
        GenerationError: The parameters need a goal.
        FileError: The task has faults.
    """

    plays_shifts = True

    def __init__(
        self,
        task: Task,
        kind: Kind = Kind.FREE,
        parameters: Parameters = DEFAULT,
        *,
        solver: Solver = shortest,
        attempts: int = ATTEMPTS,
    ) -> None:
        if kind is Kind.NOISY:
            raise GenerationError("kind", f"{task.name} is a shift, which has no plan to keep")
        if parameters.banded:
            name = "max_steps" if parameters.min_steps is None else "min_steps"
            raise GenerationError(name, f"{task.name} is a shift, which has no shortest plan")
        if parameters.held:
            raise GenerationError("held", "everything begins on a station in a shift")
        super().__init__(task, kind, parameters, solver=solver, attempts=attempts)

    def _arranged(self, rng: SeededRng) -> Arrangement:
        asked = self.parameters
        # An irrelevant station could be one more place to serve or to work at.
        amounts = replace(asked, stations=asked.stations or 0, items=asked.items or 0)
        return arrange(self._parts, self._stock, Kind.NOISY, amounts, rng)

    def _varied(self, rng: SeededRng) -> Task:
        problem = self.task.problem
        shift = None if problem.shift is None else varied(problem.shift, rng)
        update = {"shift": shift, "goal_description": _description(shift)}
        return replace(self.task, problem=problem.model_copy(update=update))

    def _proven(self, instance: Instance) -> Instance:
        for fault in lint_task(instance.task):
            if fault.severity == "error":
                raise AttemptError("task", str(fault))
        points, results = dict[int, int](), dict[int, SearchResult]()
        for seats in seat_counts(self.task):
            plan, last = play_shift(instance.world(seats))
            if last.orders is None or not last.orders.served:
                raise AttemptError("task", f"planner bots serve no order with {seats} players")
            points[seats] = last.orders.score
            results[seats] = SearchResult(plan, 0, Proof.NONE, "planner bots", 0)
        rated = with_planner_points(instance, points, stars_of(points))
        return replace(rated, results=results)


def stars_of(points: Mapping[int, int]) -> dict[int, tuple[int, int, int]]:
    """Return the points for one, two and three stars by the points of planner bots.

    Both are by the number of seats. A larger team needs at least as many points as a smaller one.
    """
    most = accumulate((max(0, points[seats]) for seats in sorted(points)), max)
    shares = (tuple(ceil(round(share * each, 6)) for share in STARS) for each in most)
    return {
        seats: (max(1, one), max(1, two), max(1, three))
        for seats, (one, two, three) in zip(sorted(points), shares, strict=True)
    }


def _description(shift: Shift | None) -> str:
    """Return what to do in a shift whose menu has been drawn."""
    return f"Serve what the guests order: {', '.join(shift.menu) if shift else 'nothing'}."


def varied(shift: Shift, rng: SeededRng) -> Shift:
    """Return a shift with half of the menu or more, and orders at similar intervals."""
    dishes = list(shift.menu)
    count = rng.between((len(dishes) + 1) // 2, len(dishes))
    chosen = sorted(rng.shuffled(dishes)[:count], key=dishes.index)
    # A task has drawn its arrivals already.
    times = [each.at for each in shift.arrivals if isinstance(each, Arrival)]
    return shift.model_copy(
        update={
            "menu": {name: shift.menu[name] for name in chosen},
            "arrivals": tuple(_arrivals(times, chosen, shift.steps, rng)),
            "stars": {},
            "planner": {},
            "planner_people": {},
        }
    )


def _arrivals(
    times: Sequence[int], dishes: Sequence[str], steps: int, rng: SeededRng
) -> list[Arrival]:
    """Return orders at random intervals, which lie in the range of the intervals of `times`."""
    intervals = [later - earlier for earlier, later in pairwise(sorted(times))] or [steps]
    low, high = max(1, min(intervals)), max(1, *intervals)
    found, at = [Arrival(at=min(times), dish=rng.one_of(dishes))], min(times)
    while (at := at + rng.between(low, high)) < steps and len(found) < MAX_ORDERS:
        found.append(Arrival(at=at, dish=rng.one_of(dishes)))
    return found
