"""What the objects of an original are called in an instance, and plans carried over by that."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from robotouille.domain.task import Task
from robotouille.generation.layout.decomposition import Key
from robotouille.planning.plan import Plan
from robotouille.world.grounding.objects import place_objects
from robotouille.world.world import World

__all__ = ["Renaming"]


@dataclass(frozen=True, slots=True)
class Renaming:
    """Names in an instance by names in its original.

    `shifts` says, for a kind, how many more of it the instance has at the start: what is created
    during play is numbered on from there.
    """

    names: Mapping[str, str]
    shifts: Mapping[str, int] = field(default_factory=dict)

    @staticmethod
    def between(original: Task, instance: Task) -> Renaming:
        """The renaming for tasks with as many seats; originals come first in every list."""
        before, after = _names(original), _names(instance)
        shifts = Counter(map(_kind, after.values()))
        shifts.subtract(map(_kind, before.values()))
        return Renaming({name: after[key] for key, name in before.items()}, dict(shifts))

    def __call__(self, name: str) -> str:
        """The name in the instance; of something created during play, by its number."""
        if name in self.names:
            return self.names[name]
        kind = _kind(name)
        number = name[len(kind) :]
        return f"{kind}{int(number) + self.shifts.get(kind, 0)}" if number else name

    def carry(self, plan: Plan, world: World) -> Plan:
        """A plan for the original as one for a world of the instance.

        Raises:
            UnknownNameError: The plan has an action or object that the instance has not.
            WrongWorldError: It creates more of a kind than a world makes room for.
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
    """The name of each object that a task starts with; no two of a kind are in one place."""
    placed = {(o.type, o.kind, o.tile, o.level): o.name for o in place_objects(task)}
    return {
        (type_, number): placed[type_, o.name, (o.x, o.y), o.stack_level]
        for type_, things in task.problem.objects.items()
        for number, o in enumerate(things)
        if type_ not in task.domain.player_types or number < task.seats
    }
