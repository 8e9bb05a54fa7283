"""A state of a grounded task: what is true in it, and what runs."""

from __future__ import annotations

import hashlib
from typing import Any

from robotouille.errors import UnknownNameError, WrongArgumentError, did_you_mean
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, Object
from robotouille.world.timers import Progress, TimerRow, Timers

__all__ = ["GroundState"]


class GroundState:
    """What the facts and the timers of a state say by themselves; `State` adds what can be done.

    States are equal when their facts and timers are.
    """

    __slots__ = ("facts", "timers", "world")

    world: GroundTask
    facts: int
    timers: Timers

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GroundState):
            return NotImplemented
        if self.facts != other.facts:
            return False
        if self.timers is other.timers:
            return True
        return self._timer_key() == other._timer_key()

    def __hash__(self) -> int:
        return hash(self.facts)

    def _timer_key(self) -> tuple[Any, ...]:
        return self.timer_rows(), self.timers.busy

    def timer_rows(self) -> tuple[TimerRow, ...]:
        """The active effects as `(action, index, arguments, counters)`, in order of creation."""
        return self.timers.rows()

    @property
    def goal_reached(self) -> bool:
        """Whether some choice of objects makes every predicate of the goal true."""
        return self.world.goal.reached(self.facts)

    @property
    def objects(self) -> tuple[Object, ...]:
        """The objects that exist now, created ones included, by type."""
        return self.world.objects_in(self.facts)

    def holds(self, predicate: str, *arguments: str) -> bool:
        """Whether a fact is true, e.g. `state.holds("iscut", "lettuce1")`.

        One about an object that does not exist (yet) is not.

        Raises:
            UnknownNameError: The domain has no such predicate.
            WrongArgumentError: There are too many or too few objects, or something that cannot be
                a name, such as a list, is given for one.
        """
        if not all(isinstance(name, str) for name in (predicate, *arguments)):
            found = ", ".join(map(repr, (predicate, *arguments)))
            raise WrongArgumentError(f"expected names, found {found}")
        types = self.world.table.types.get(predicate)
        if types is None:
            known = did_you_mean(predicate, self.world.table.types)
            raise UnknownNameError(f"no predicate {predicate!r}{known}")
        if len(types) != len(arguments):
            told = f"({', '.join(arguments)})"
            raise WrongArgumentError(f"{predicate} takes {len(types)} names, found {told}")
        return self.world.table.holds((predicate, *arguments), self.facts)

    def atoms(self) -> list[Atom]:
        """Every true fact as `(predicate, argument, …)`, sorted."""
        return sorted(self.world.table.true_atoms(self.facts))

    def fact_names(self) -> list[str]:
        """Every true fact as `predicate(argument, …)`, sorted."""
        return sorted(self.world.table.true_names(self.facts))

    def busy_steps(self, player: str) -> int:
        """For how many more steps a player is walking or working and cannot act."""
        return self.timers.busy_steps(player)

    def progress(self) -> tuple[Progress, ...]:
        """All that time or work is bringing about, in order of creation: a patty that cooks."""
        return self.timers.progress()

    @property
    def digest(self) -> str:
        """A content hash (32 hex digits), equal across processes, versions and bit orders."""
        rows = [f"{a}.{i}({','.join(args)})={counts}" for a, i, args, counts in self.timer_rows()]
        rows += [f"busy({name})={steps}" for name, steps in self.timers.busy]
        used = self.world.used_objects(self.facts)
        text = "\n".join(["facts", *self.fact_names(), "timers", *rows, "used", *used])
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
