"""Generator that turns a task and a seed into a provably solvable instance.

It follows the Robotouille paper, section 2, "Procedural Generation": objects are shuffled and new
ones are added. A seed stands for a sequence of attempts, numbered from 1, which draw different
kitchens. The first solvable kitchen is the instance, and its file records the number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property

from robotouille.certification.step_limit import plan_beside
from robotouille.domain.loading import load_task, task_names
from robotouille.domain.schema import Provenance
from robotouille.domain.task import Task, Timing
from robotouille.generation.arrangement import Arrangement, arrange, lay_out, size_for
from robotouille.generation.decomposition import ProblemParts, Roles, Stock
from robotouille.generation.instance import Instance, seat_counts, write_instance
from robotouille.generation.parameters import (
    DEFAULT,
    AttemptError,
    GenerationError,
    Kind,
    Parameters,
    SeededRng,
)
from robotouille.planning.plan import Limits, Plan, Proof, SearchResult, replay
from robotouille.planning.solvers import solve
from robotouille.world.world import World

Solver = Callable[[World], SearchResult]
"""Function that finds a plan for all players of a world from its initial state."""

EXPANSIONS = (20_000, 1_000, 50, 2)
"""Expansions of the default solver by number of players. Their effect is the same on every machine.
"""


def shortest(world: World) -> SearchResult:
    """Return a shortest plan, or a good one with a bound.

    Raises:
        PluginError: An installed plug-in cannot be loaded.
    """
    players = min(len(world.players), len(EXPANSIONS))
    return solve(world, limits=Limits(expansions=EXPANSIONS[players - 1]))


def solved(world: World, solver: Solver) -> SearchResult:
    """Return a solver's result with a replayed plan.

    Raises:
        AttemptError: The solver finds no plan, or the plan does not work.
    """
    if world.initial.goal_reached:
        raise AttemptError("seed", "the goal holds at the start")
    result = solver(world)
    players = len(world.players)
    if result.plan is None:
        how = "there is no plan" if result.unsolvable else "no plan was found"
        raise AttemptError("solver", f"{how} for {players} players")
    return replace(result, plan=working(result.plan, world))


def carried(plan: Plan, instance: Instance, seats: int) -> SearchResult:
    """Return a plan for the original, renamed for an instance and replayed there."""
    world = instance.world(seats)
    there = working(instance.renaming(seats).carry(plan, world), world)
    return SearchResult(there, 0, Proof.NONE, "carried over", 0)


def working(plan: Plan, world: World) -> Plan:
    """Return a plan up to the step in which it reaches the goal.

    Raises:
        AttemptError: The plan does not work.
    """
    report = replay(plan, world)
    if report.rejection is not None or not report.reached_at:
        message = f"a plan for {len(world.players)} players does not work: {report}"
        raise AttemptError("solver", message)
    # A renamed plan may reach the goal early, with the help of irrelevant objects.
    return Plan(plan.steps[: report.reached_at])


def check_band(result: SearchResult, parameters: Parameters) -> None:
    """Check that the proven optimal number of steps is in the requested range.

    Raises:
        AttemptError: It is not.
    """
    low, high = result.bound, len(result.plan or ())
    found = str(high) if low >= high else f"between {low} and {high} (not proven)"
    if parameters.min_steps is not None and low < parameters.min_steps:
        message = f"expected at least {parameters.min_steps} steps; the shortest plan has {found}"
        raise AttemptError("min_steps", message)
    if parameters.max_steps is not None and high > parameters.max_steps:
        message = f"expected at most {parameters.max_steps} steps; the shortest plan has {found}"
        raise AttemptError("max_steps", message)


GENERATOR = "1"
"""Version of the generator. The instances of seeds change only with it."""

ATTEMPTS = 50
MAX_ATTEMPTS = 10_000


class Generator:
    """Generator of the instances of one task with a goal.

    Args:
        plans: Plans for the original by number of players. Missing ones are read from the files
            next to the problem, or found by the solver. Noisy instances need them.
        attempts: Maximum number of kitchens drawn for a seed, at most `MAX_ATTEMPTS`.

    Raises:
        GenerationError: The parameters contradict the kind of instance.
        FileError: The task has faults.
    """

    plays_shifts = False

    def __init__(
        self,
        task: Task,
        kind: Kind = Kind.FREE,
        parameters: Parameters = DEFAULT,
        *,
        solver: Solver = shortest,
        plans: Mapping[int, Plan] | None = None,
        attempts: int = ATTEMPTS,
    ) -> None:
        if kind is Kind.NOISY and parameters.held:
            raise GenerationError("held", "players of a noisy instance keep what they hold")
        if task.problem.shift is not None and not self.plays_shifts:
            raise GenerationError("task", f"{task.name} is a shift; use a ShiftGenerator")
        if not 1 <= attempts <= MAX_ATTEMPTS:
            found = f"expected 1 to {MAX_ATTEMPTS}, found {attempts}"
            raise GenerationError("attempts", found)
        self.task = replace(task, seats=seat_counts(task)[0], timing=Timing.BENCHMARK)
        self.kind = kind
        self.parameters = parameters
        self.attempts = attempts
        self._solver = solver
        self._plans = plans or {}
        self._roles = Roles.of(task.domain)
        self._parts = ProblemParts(self.task, self._roles)
        self._stock = Stock(self.task, self._roles)

    def instance(self, seed: int) -> Instance:
        """Return the instance of a seed from the first attempt that can be solved.

        Raises:
            GenerationError: No attempt can be solved.
            PluginError: The default solver cannot load an installed plug-in.
        """
        for attempt in range(1, self.attempts + 1):
            try:
                return self._proven(self.draw(seed, attempt))
            except AttemptError as rejected:
                last = rejected
        message = (
            f"no {self.kind} instance of {self.task.name} with seed {seed} in {self.attempts} "
            f"attempts; last attempt: {last.message}"
        )
        raise GenerationError(last.parameter, message)

    def draw(self, seed: int, attempt: int = 1) -> Instance:
        """Return the kitchen of an attempt, solvable or not.

        Args:
            attempt: Number of the attempt, from 1.

        Raises:
            AttemptError: The objects do not fit in this attempt.
            GenerationError: The objects do not fit in any attempt.
        """
        rng = SeededRng(f"{self.kind} {seed} {attempt}")
        arrangement = self._arranged(rng)
        stations = [t.key for t in arrangement.things if t.type in self._roles.stations]
        problem = self.task.problem
        size = size_for(len(stations), problem.width, problem.height, self.parameters)
        floorplan = lay_out(stations, arrangement.faces, *size, rng)
        provenance = Provenance(
            source=self.task.name,
            seed=seed,
            kind=self.kind.value,
            attempt=attempt,
            parameters=self.parameters.asked(),
            generator=GENERATOR,
        )
        return write_instance(self._varied(rng), arrangement, floorplan, provenance)

    def _arranged(self, rng: SeededRng) -> Arrangement:
        """Return the objects of an attempt on their stations."""
        return arrange(self._parts, self._stock, self.kind, self.parameters, rng)

    def _varied(self, rng: SeededRng) -> Task:
        """Return the task with what an attempt changes apart from the objects."""
        return self.task

    def _proven(self, instance: Instance) -> Instance:
        """Return a drawn instance with its proof.

        Raises:
            AttemptError: It cannot be proven to be solvable.
        """
        return replace(instance, results=self._results(instance))

    def _results(self, instance: Instance) -> dict[int, SearchResult]:
        """Return a proof for each number of players.

        Raises:
            AttemptError: A proof is missing.
        """
        results = {}
        for seats in seat_counts(self.task):
            usual = seats == self.task.seats
            if self.kind is Kind.NOISY and not (usual and self.parameters.banded):
                results[seats] = carried(self._original_plans[seats], instance, seats)
                continue
            results[seats] = solved(instance.world(seats), self._solver)
            if usual:
                check_band(results[seats], self.parameters)
        return results

    @cached_property
    def _original_plans(self) -> dict[int, Plan]:
        return {seats: self._original_plan(seats) for seats in seat_counts(self.task)}

    def _original_plan(self, seats: int) -> Plan:
        world = World(replace(self.task, seats=seats))
        known = self._plans.get(seats) or plan_beside(world)
        try:
            return working(known or self._solved_plan(world), world)
        except AttemptError as rejected:
            raise GenerationError("task", f"{self.task.name}: {rejected.message}") from None

    def _solved_plan(self, world: World) -> Plan:
        return solved(world, self._solver).plan or Plan(())


FOLDERS = ("synchronous", "asynchronous", "multi_agent")


def seeds_from(first: int, count: int) -> tuple[int, ...]:
    """Return the seeds of a series: multiples of the first, as in the paper's data sets."""
    return tuple(first * position for position in range(1, count + 1))


SEEDS = seeds_from(42, 15)
"""42, 84 and so on to 630. The paper's instances have the first ten seeds, but are other kitchens.
"""

LAST_NOISY = 10
"""Position of the last noisy instance: ten of fifteen are free."""


def paper_tasks() -> tuple[str, ...]:
    """Return the thirty tasks of the paper."""
    names = [name for name in task_names() if name.count("/") == 1]
    return tuple(n for folder in FOLDERS for n in names if n.startswith(f"{folder}/"))


def kind_at(position: int) -> Kind:
    """Return the kind of a task's instance by its position, from 1.

    Free and noisy instances alternate up to the tenth; the later ones are free.
    """
    return Kind.NOISY if position % 2 == 0 and position <= LAST_NOISY else Kind.FREE


def generate_dataset(
    tasks: Iterable[str] | None = None,
    seeds: Iterable[int] = SEEDS,
    parameters: Parameters = DEFAULT,
    *,
    solver: Solver = shortest,
) -> Iterator[Instance]:
    """Yield the instances of tasks, by default the paper's, task by task and seed by seed.

    Args:
        tasks: Names or paths for `load_task`.

    Raises:
        UnknownTaskError: A task does not exist.
        FileError: A task has faults.
        GenerationError: A seed gives no instance; `parameter` names the option to change.
    """
    row = tuple(seeds)
    for name in paper_tasks() if tasks is None else tasks:
        task = load_task(name)
        generators = {kind: Generator(task, kind, parameters, solver=solver) for kind in Kind}
        for position, seed in enumerate(row, start=1):
            yield generators[kind_at(position)].instance(seed)
