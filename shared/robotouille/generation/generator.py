"""From a task and a seed to an instance that is proven solvable.

Paper, section 2, "Procedural Generation": objects are shuffled and new ones added. A seed stands
for a row of attempts, numbered from 1, each of which draws another kitchen; the first that can be
solved is the instance. Its file says which one that was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

from robotouille.certification.shipped_plan import plan_beside
from robotouille.domain.schema import Provenance
from robotouille.domain.task import Task, Timing
from robotouille.generation.instance import Instance, seat_counts, write_instance
from robotouille.generation.layout.arrangement import arrange
from robotouille.generation.layout.decomposition import ProblemParts
from robotouille.generation.layout.floorplan import lay_out, size_for
from robotouille.generation.layout.stock import Stock
from robotouille.generation.layout.type_roles import Roles
from robotouille.generation.parameters import (
    DEFAULT,
    AttemptError,
    GenerationError,
    Kind,
    Parameters,
)
from robotouille.generation.proof import (
    Solver,
    carried,
    check_band,
    shortest,
    solved,
    working,
)
from robotouille.generation.rng import SeededRng
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import SearchResult
from robotouille.world.world import World

__all__ = ["ATTEMPTS", "GENERATOR", "Generator", "generate"]

GENERATOR = "1"
"""The version of the generator: what a seed gives changes only with it."""

ATTEMPTS = 50


def generate(
    task: Task,
    seed: int,
    kind: Kind = Kind.FREE,
    parameters: Parameters = DEFAULT,
    *,
    solver: Solver = shortest,
) -> Instance:
    """An instance of a task, proven solvable for every number of players that the task allows.

    Raises:
        GenerationError: There is none; `parameter` names what to ask for instead.
        FileError: The task itself has faults.
        PluginError: The usual solver asks an installed plug-in, and that cannot be loaded.
    """
    return Generator(task, kind, parameters, solver=solver).instance(seed)


class Generator:
    """Makes the instances of one task.

    Args:
        plans: Plans for the original by number of players; those missing are read from the files
            beside the problem, or found by the solver. Noisy instances need them.
        attempts: Kitchens that are drawn for a seed, at most.

    Raises:
        GenerationError: The parameters go with no instance of this kind.
        FileError: The task itself has faults.
    """

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
            raise GenerationError("held", "players of a noisy instance hold what they did")
        if attempts < 1:
            raise GenerationError("attempts", f"expected at least 1, found {attempts}")
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
        """The instance of a seed: that of the first attempt which can be solved.

        Raises:
            GenerationError: There is none in so many attempts.
            PluginError: The usual solver asks an installed plug-in, and that cannot be loaded.
        """
        for attempt in range(1, self.attempts + 1):
            try:
                instance = self.draw(seed, attempt)
                return replace(instance, results=self._results(instance))
            except AttemptError as rejected:
                last = rejected
        message = (
            f"no {self.kind} instance of {self.task.name} with seed {seed} in {self.attempts} "
            f"attempts; the last one: {last.message}"
        )
        raise GenerationError(last.parameter, message)

    def draw(self, seed: int, attempt: int = 1) -> Instance:
        """What an attempt gives, solvable or not.

        Args:
            attempt: Its number, from 1.

        Raises:
            AttemptError: Things do not fit this time.
            GenerationError: They never do.
        """
        rng = SeededRng(f"{self.kind} {seed} {attempt}")
        arrangement = arrange(self._parts, self._stock, self.kind, self.parameters, rng)
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
        return write_instance(self.task, arrangement, floorplan, provenance)

    def _results(self, instance: Instance) -> dict[int, SearchResult]:
        """A proof for each number of players; AttemptError where one is missing."""
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
