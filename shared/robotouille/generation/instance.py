"""Generated instances: a new problem file, its task, and the proof that it can be solved."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from robotouille.domain.json_files import parse_json, validate
from robotouille.domain.schema import ObjectDef, ProblemFile, Provenance
from robotouille.domain.task import Task, build_task
from robotouille.generation.arrangement import Arrangement, Floorplan
from robotouille.generation.decomposition import Key, PlacedObject
from robotouille.planning.plan import Plan, SearchResult, write_plan
from robotouille.world.grounding.objects import place_objects
from robotouille.world.world import World

WIDTH = 100
"""Maximum length of a line with several entries."""

LISTED = ("station", "item", "container", "meal", "player")
"""Types with lists of their own (`stations`), unless a file needs `objects`."""


def object_json(definition: ObjectDef, *, levelled: bool) -> dict[str, Any]:
    """Return an object as JSON values, with its stack level if it has one or if `levelled`."""
    raw: dict[str, Any] = {"name": definition.name, "x": definition.x, "y": definition.y}
    if levelled or definition.stack_level:
        raw["stack-level"] = definition.stack_level
    if definition.direction is not None:
        raw["direction"] = list(definition.direction)
    if definition.predicates:
        raw["predicates"] = list(definition.predicates)
    if definition.id is not None:
        raw["id"] = definition.id
    return raw


def write_problem(problem: dict[str, Any]) -> str:
    """Return the text of a problem, with one list entry per line and short fields on one line."""
    fields = dict(problem)
    objects = fields.get("objects")
    if objects is not None and all(kind in LISTED for kind in objects):
        fields = {}
        for name, value in problem.items():
            lists = {f"{kind}s": things for kind, things in objects.items()}
            fields.update(lists if name == "objects" else {name: value})
    lines = [f"  {_text(name)}: {_field(name, value, '  ')}" for name, value in fields.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _field(name: str, value: Any, indent: str) -> str:
    inner = f"{indent}  "
    if isinstance(value, dict) and (
        name == "objects" or len(indent) + len(name) + len(_text(value)) + 5 > WIDTH
    ):
        rows = [f"{_text(key)}: {_field(key, part, inner)}" for key, part in value.items()]
    elif isinstance(value, list) and value and isinstance(value[0], str | dict):
        rows = [_text(entry) for entry in value]
    else:
        return _text(value)
    brackets = "{}" if isinstance(value, dict) else "[]"
    body = ",\n".join(f"{inner}{row}" for row in rows)
    return f"{brackets[0]}\n{body}\n{indent}{brackets[1]}"


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class Renaming:
    """Names in an instance by names in its original.

    `shifts` contains the number of additional initial objects of each kind. Objects created during
    play are numbered after them.
    """

    names: Mapping[str, str]
    shifts: Mapping[str, int] = field(default_factory=dict)

    @staticmethod
    def between(original: Task, instance: Task) -> Renaming:
        """Return the renaming between tasks with equal seats."""
        # Original objects come first in every list, so keys identify them.
        before, after = _names(original), _names(instance)
        shifts = Counter(map(_kind, after.values()))
        shifts.subtract(map(_kind, before.values()))
        return Renaming({name: after[key] for key, name in before.items()}, dict(shifts))

    def __call__(self, name: str) -> str:
        """Return a name in the instance. Created objects are renamed by their number."""
        if name in self.names:
            return self.names[name]
        kind = _kind(name)
        number = name[len(kind) :]
        return f"{kind}{int(number) + self.shifts.get(kind, 0)}" if number else name

    def carry(self, plan: Plan, world: World) -> Plan:
        """Return a plan for the original as a plan for a world of the instance.

        Raises:
            UnknownNameError: The instance lacks an action or object of the plan.
            WrongWorldError: The plan creates more objects of a kind than a world has room for.
        """
        steps = []
        for joint in plan:
            renamed = [(action.name, [self(a) for a in action.arguments]) for action in joint]
            for _, arguments in renamed:
                world.admit(arguments)
            steps.append(tuple(world.action(name, *arguments) for name, arguments in renamed))
        return Plan(tuple(steps))


def _kind(name: str) -> str:
    return name.rstrip("0123456789")


def _names(task: Task) -> dict[Key, str]:
    """Return the name of each initial object. No two objects of a kind share a place."""
    placed = {(o.type, o.kind, o.tile, o.level): o.name for o in place_objects(task)}
    return {
        (type_, number): placed[type_, o.name, (o.x, o.y), o.stack_level]
        for type_, things in task.problem.objects.items()
        for number, o in enumerate(things)
        if type_ not in task.domain.player_types or number < task.seats
    }


def seat_counts(task: Task) -> tuple[int, ...]:
    """Return the numbers of players of a problem, the default first."""
    return task.problem.seats or (task.seats,)


@dataclass(frozen=True)
class Instance:
    """A generated problem.

    `name` is the file name without `.json`, `text` its content, and `task` the loaded task.
    `results` contains the proof for each number of players; it is empty for drawn instances.
    """

    name: str
    text: str
    task: Task
    original: Task
    provenance: Provenance
    results: Mapping[int, SearchResult] = field(default_factory=dict)

    def world(self, seats: int | None = None) -> World:
        """Return the world for a number of players, by default the task's."""
        return World(replace(self.task, seats=seats or self.task.seats))

    def plan_text(self, seats: int | None = None) -> str:
        """Return the text of the plan file for a number of players, by default the task's.

        Raises:
            KeyError: There is no proof for this number.
        """
        count = seats or self.task.seats
        return write_plan(self.results[count].plan or Plan(()), self.world(count))

    def renaming(self, seats: int | None = None) -> Renaming:
        """Return the instance's names of the original's objects."""
        count = seats or self.task.seats
        return Renaming.between(
            replace(self.original, seats=count), replace(self.task, seats=count)
        )


def write_instance(
    original: Task, arrangement: Arrangement, floorplan: Floorplan, provenance: Provenance
) -> Instance:
    """Return the instance with the objects of an arrangement on the tiles of a floorplan."""
    name = f"{original.name.rpartition('/')[2]}_s{provenance.seed}"
    objects = _objects(original, arrangement, floorplan)
    unnamed = replace(original, problem=original.problem.model_copy(update={"objects": objects}))
    renaming = Renaming.between(original, unnamed)
    text = write_problem(_problem(original, objects, floorplan, renaming, provenance))
    return Instance(name, text, _task(name, text, original), original, provenance)


def _task(name: str, text: str, original: Task) -> Task:
    problem = validate(parse_json(text, name), ProblemFile, name)
    return build_task(name, original.domain, problem, source=name)


def with_planner_points(
    instance: Instance, points: Mapping[int, int], stars: Mapping[int, Sequence[int]]
) -> Instance:
    """Return an instance of a shift with points of planner bots and for stars, by seats."""
    raw = json.loads(instance.text)
    raw["shift"]["stars"] = {str(seats): [*each] for seats, each in stars.items()}
    raw["shift"]["planner"] = {str(seats): each for seats, each in points.items()}
    # Only the shipped shifts have the points for the other timing profile, which take minutes.
    raw["shift"].pop("planner_people", None)
    text = write_problem(raw)
    return replace(instance, text=text, task=_task(instance.name, text, instance.original))


def _objects(
    original: Task, arrangement: Arrangement, floorplan: Floorplan
) -> dict[str, tuple[ObjectDef, ...]]:
    """Return the objects at their new places, by type in the domain's order."""
    listed = original.problem.objects
    return {
        type_: things
        for type_ in original.domain.object_types
        if (things := tuple(_placed(arrangement, floorplan, type_))) or type_ in listed
    }


def _placed(arrangement: Arrangement, floorplan: Floorplan, type_: str) -> list[ObjectDef]:
    return [_moved(t, arrangement, floorplan) for t in arrangement.things if t.type == type_]


def _moved(thing: PlacedObject, arrangement: Arrangement, floorplan: Floorplan) -> ObjectDef:
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
    raw["goal_description"] = problem.goal_description
    if problem.shift is None:
        raw["goal"] = [term.model_dump(mode="json") for term in problem.goal]
    else:
        raw["shift"] = problem.shift.model_dump(mode="json", exclude_defaults=True)
    raw["provenance"] = provenance.model_dump(mode="json")
    return raw


def _types(task: Task, predicate: str) -> tuple[str, ...]:
    return next(p.param_types for p in task.domain.predicate_defs if p.name == predicate)


def _fitted(ground: tuple[str, ...], width: int, height: int) -> list[str]:
    """Return floor letters for another size, cropped or with the last ones repeated."""
    rows = [row[:width] + row[-1:] * (width - len(row)) for row in ground[:height]]
    return rows + rows[-1:] * (height - len(rows))
