"""A state of the world: the facts that hold and the timers that run, as one immutable value."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from robotouille.world.grounding.objects import Atom

if TYPE_CHECKING:
    from robotouille.world.grounding.actions import GroundAction
    from robotouille.world.grounding.objects import Object
    from robotouille.world.timers import Timers
    from robotouille.world.world import Step, World

__all__ = ["Progress", "State"]


class Progress(NamedTuple):
    """How far something has come: `done` of `total` steps or performances of `action`.

    `running` is False while it is paused, e.g. a patty taken off its stove; `timed` tells what
    time brings about from what needs to be done again and again.
    """

    action: str
    arguments: tuple[str, ...]
    subject: str
    done: int
    total: int
    running: bool
    timed: bool = True


class State:
    """`s = (facts, timers)` of the paper's section 2.

    Immutable, hashable and cheap to keep: an integer and a shared tuple. `pickle` and `copy` work;
    states are equal when their facts and timers are.
    """

    __slots__ = ("facts", "timers", "world")

    world: World
    facts: int
    timers: Timers

    def __init__(self, world: World, facts: int, timers: Timers) -> None:
        self.world = world
        self.facts = facts
        self.timers = timers

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, State):
            return NotImplemented
        if self.facts != other.facts:
            return False
        if self.timers is other.timers:
            return True
        return self._timer_key() == other._timer_key()

    def __hash__(self) -> int:
        return hash(self.facts)

    def __repr__(self) -> str:
        return f"<State of {self.world.task.name} {self.digest}>"

    def __copy__(self) -> State:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> State:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self.world, self.facts, self.timer_rows(), self.timers.busy)

    def _timer_key(self) -> tuple[Any, ...]:
        return self.timer_rows(), self.timers.busy

    def timer_rows(self) -> tuple[tuple[str, int, tuple[str, ...], tuple[int, ...]], ...]:
        """The active effects as `(action, index, arguments, counters)`, in order of creation."""
        return tuple((*effect.label, progress) for effect, progress in self.timers.entries)

    @property
    def goal_reached(self) -> bool:
        """Whether some choice of objects makes every predicate of the goal true."""
        return self.world.goal.reached(self.facts)

    @property
    def objects(self) -> tuple[Object, ...]:
        """The objects that exist now, created ones included, by type."""
        return self.world.objects_in(self.facts)

    def holds(self, predicate: str, *arguments: str) -> bool:
        """Whether a fact is true, e.g. `state.holds("iscut", "lettuce1")`."""
        return self.world.table.holds((predicate, *arguments), self.facts)

    def atoms(self) -> list[Atom]:
        """Every true fact as `(predicate, argument, …)`, sorted."""
        return sorted(self.world.table.true_atoms(self.facts))

    def fact_names(self) -> list[str]:
        """Every true fact as `predicate(argument, …)`, sorted."""
        return sorted(self.world.table.true_names(self.facts))

    def actions(self, player: str) -> tuple[GroundAction, ...]:
        """The valid actions of a player in a stable order: as in the domain, then by object."""
        return self.world.actions(self, player)

    def step(
        self, actions: GroundAction | Sequence[GroundAction | None] | Mapping[str, GroundAction]
    ) -> Step:
        """Take a joint action (or one player's action); see `World.step`."""
        return self.world.step(self, actions)

    def busy_steps(self, player: str) -> int:
        """For how many more steps a player is walking or working and cannot act."""
        return self.timers.busy_steps(player)

    def progress(self) -> tuple[Progress, ...]:
        """Everything that cooks, fries, fills, boils or is being cut, in order of creation."""
        found = []
        for effect, counters in self.timers.entries:
            for node in effect.counters():
                if counters[node.slot] >= 0:
                    action, _, arguments = effect.label
                    row = Progress(
                        action=action,
                        arguments=arguments,
                        subject=node.subject,
                        done=counters[node.slot],
                        total=node.total,
                        running=effect.root.kind != "conditional" or counters[0] == 1,
                        timed=node.kind == "delayed",
                    )
                    found.append(row)
        return tuple(found)

    def text(self, player: str | None = None) -> str:
        """The observation in words (world.md, "Text"), with the valid actions of `player`."""
        from robotouille.world.text import observation

        return observation(self, player)

    @property
    def digest(self) -> str:
        """A content hash (32 hex digits), equal across processes, versions and bit orders."""
        rows = [f"{a}.{i}({','.join(args)})={counts}" for a, i, args, counts in self.timer_rows()]
        rows += [f"busy({name})={steps}" for name, steps in self.timers.busy]
        used = self.world.used_objects(self.facts)
        text = "\n".join(["facts", *self.fact_names(), "timers", *rows, "used", *used])
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _restore(
    world: World,
    facts: int,
    rows: tuple[tuple[str, int, tuple[str, ...], tuple[int, ...]], ...],
    busy: tuple[tuple[str, int], ...],
) -> State:
    return world.restore(facts, rows, busy)
