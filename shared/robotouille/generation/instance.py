"""An instance: a new problem file, the task in it, and the proof that it can be solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from robotouille.domain.files import parse_json, validate
from robotouille.domain.schema import ObjectDef, ProblemFile, Provenance
from robotouille.domain.task import Task, build_task
from robotouille.generation.layout.arrangement import Arrangement
from robotouille.generation.layout.decomposition import Thing
from robotouille.generation.layout.floorplan import Floorplan
from robotouille.generation.renaming import Renaming
from robotouille.generation.writing import object_json, write_problem
from robotouille.planning.plan import Plan, write_plan
from robotouille.planning.search_result import SearchResult
from robotouille.world.world import World

__all__ = ["Instance", "seat_counts", "write_instance"]


def seat_counts(task: Task) -> tuple[int, ...]:
    """The numbers of players that a problem is for, the usual one first."""
    return task.problem.seats or (task.seats,)


@dataclass(frozen=True)
class Instance:
    """A generated problem.

    `name` is the file's name without `.json`, `text` its content, `task` what loading it gives.
    `results` has the proof for each number of players; none if it was only drawn.
    """

    name: str
    text: str
    task: Task
    original: Task
    provenance: Provenance
    results: Mapping[int, SearchResult] = field(default_factory=dict)

    def world(self, seats: int | None = None) -> World:
        """The world for a number of players (the usual one if None)."""
        return World(replace(self.task, seats=seats or self.task.seats))

    def plan_text(self, seats: int | None = None) -> str:
        """The text of the plan file for a number of players (the usual one if None).

        Raises:
            KeyError: Nothing is proven for so many.
        """
        count = seats or self.task.seats
        return write_plan(self.results[count].plan or Plan(()), self.world(count))

    def renaming(self, seats: int | None = None) -> Renaming:
        """What the original's objects are called here; players' names depend on their number."""
        count = seats or self.task.seats
        return Renaming.between(
            replace(self.original, seats=count), replace(self.task, seats=count)
        )


def write_instance(
    original: Task, arrangement: Arrangement, floorplan: Floorplan, provenance: Provenance
) -> Instance:
    """The instance in which the things of an arrangement are on the tiles of a floorplan."""
    name = f"{original.name.rpartition('/')[2]}_s{provenance.seed}"
    objects = _objects(original, arrangement, floorplan)
    unnamed = replace(original, problem=original.problem.model_copy(update={"objects": objects}))
    renaming = Renaming.between(original, unnamed)
    text = write_problem(_problem(original, objects, floorplan, renaming, provenance))
    problem = validate(parse_json(text, name), ProblemFile, name)
    task = build_task(name, original.domain, problem, source=name)
    return Instance(name, text, task, original, provenance)


def _objects(
    original: Task, arrangement: Arrangement, floorplan: Floorplan
) -> dict[str, tuple[ObjectDef, ...]]:
    """The objects where they are now, by type as the domain lists them."""
    listed = original.problem.objects
    return {
        type_: things
        for type_ in original.domain.object_types
        if (things := tuple(_placed(arrangement, floorplan, type_))) or type_ in listed
    }


def _placed(arrangement: Arrangement, floorplan: Floorplan, type_: str) -> list[ObjectDef]:
    return [_moved(t, arrangement, floorplan) for t in arrangement.things if t.type == type_]


def _moved(thing: Thing, arrangement: Arrangement, floorplan: Floorplan) -> ObjectDef:
    host, level = arrangement.carrier.get(thing.key, (thing.key, 0))
    x, y = floorplan.tiles[host]
    direction = floorplan.directions.get(thing.key)
    update = {"x": x, "y": y, "stack_level": level, "direction": direction}
    return thing.definition.model_copy(update=update)


def _problem(
    original: Task,
    objects: dict[str, tuple[ObjectDef, ...]],
    floorplan: Floorplan,
    renaming: Renaming,
    provenance: Provenance,
) -> dict[str, Any]:
    problem = original.problem
    stacked = {
        type_
        for rule in original.domain.layout or ()
        if rule.when == "next_in_stack"
        for type_ in _types(original, rule.predicate)
    }
    raw: dict[str, Any] = {"version": "2.0"}
    if problem.domain is not None:
        raw["domain"] = problem.domain
    raw |= {"width": floorplan.width, "height": floorplan.height}
    if problem.ground:
        raw["ground"] = _fitted(problem.ground, floorplan.width, floorplan.height)
    raw["config"] = {
        key: {renaming.names.get(name, name): steps for name, steps in table.items()}
        for key, table in problem.config.items()
    }
    if problem.seats is not None:
        raw["seats"] = list(problem.seats)
    raw["objects"] = {
        type_: [object_json(o, levelled=type_ in stacked) for o in things]
        for type_, things in objects.items()
    }
    goal = [term.model_dump(mode="json") for term in problem.goal]
    raw |= {"goal_description": problem.goal_description, "goal": goal}
    raw["provenance"] = provenance.model_dump(mode="json")
    return raw


def _types(task: Task, predicate: str) -> tuple[str, ...]:
    return next(p.param_types for p in task.domain.predicate_defs if p.name == predicate)


def _fitted(ground: tuple[str, ...], width: int, height: int) -> list[str]:
    """Floor letters for another size: cut off, or the last ones repeated."""
    rows = [row[:width] + row[-1:] * (width - len(row)) for row in ground[:height]]
    return rows + rows[-1:] * (height - len(rows))
