"""State of a grounded task: its facts and timers, how they are packed, and joint actions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgpack

from robotouille.domain.task import Task
from robotouille.errors import UnknownNameError, WrongArgumentError, WrongWorldError, did_you_mean
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, Object
from robotouille.world.shift import Orders
from robotouille.world.timers import BusyRow, Progress, TimerRow, Timers


class GroundState:
    """Facts, timers and orders of a state, without actions and steps; `State` adds those.

    States are equal if these are equal. Only the states of a shift have `orders`.
    """

    __slots__ = ("facts", "orders", "timers", "world")

    world: GroundTask
    facts: int
    timers: Timers
    orders: Orders | None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GroundState):
            return NotImplemented
        if self.facts != other.facts or self.orders != other.orders:
            return False
        # Within one world, equal timers are one object. Only states of two worlds compare rows.
        if self.timers is other.timers:
            return True
        return self._timer_key() == other._timer_key()

    def __hash__(self) -> int:
        # Search hashes every state: one integer is fast, and few states differ in timers alone.
        return hash(self.facts)

    def _timer_key(self) -> tuple[Any, ...]:
        return self.timer_rows(), self.timers.busy

    def timer_rows(self) -> tuple[TimerRow, ...]:
        """Return the active effects as `(action, index, arguments, counters)`, oldest first."""
        return self.timers.rows()

    @property
    def goal_reached(self) -> bool:
        """True if a choice of objects makes every predicate of the goal true."""
        return self.world.goal.reached(self.facts)

    @property
    def objects(self) -> tuple[Object, ...]:
        """Objects that exist now, including created ones, sorted by type."""
        return self.world.objects_in(self.facts)

    def holds(self, predicate: str, *arguments: str) -> bool:
        """Return whether a fact is true, as in `state.holds("iscut", "lettuce1")`.

        A fact about an object that does not exist is false.

        Raises:
            UnknownNameError: The domain has no such predicate.
            WrongArgumentError: The number of objects is wrong, or a name is not a string.
        """
        if not all(isinstance(name, str) for name in (predicate, *arguments)):
            found = ", ".join(map(repr, (predicate, *arguments)))
            raise WrongArgumentError(f"expected names, found {found}")
        types = self.world.table.types.get(predicate)
        if types is None:
            known = did_you_mean(predicate, self.world.table.types)
            raise UnknownNameError(f"no predicate {predicate!r}{known}")
        if len(types) != len(arguments):
            given = f"({', '.join(arguments)})"
            raise WrongArgumentError(f"{predicate} takes {len(types)} names, found {given}")
        return self.world.table.holds((predicate, *arguments), self.facts)

    def atoms(self) -> list[Atom]:
        """Return every true fact as `(predicate, argument, …)`, sorted."""
        return sorted(self.world.table.true_atoms(self.facts))

    def fact_names(self) -> list[str]:
        """Return every true fact as `predicate(argument, …)`, sorted."""
        return sorted(self.world.table.true_names(self.facts))

    def busy_steps(self, player: str) -> int:
        """Return for how many more steps a player is walking or working and cannot act."""
        return self.timers.busy_steps(player)

    def progress(self) -> tuple[Progress, ...]:
        """Return the progress of all counting effects, in order of creation."""
        return self.timers.progress()

    @property
    def digest(self) -> str:
        """Content hash (32 hex digits), equal across processes, versions and bit orders."""
        rows = [f"{a}.{i}({','.join(args)})={counts}" for a, i, args, counts in self.timer_rows()]
        rows += [f"busy({name})={steps}" for name, steps in self.timers.busy]
        used = self.world.used_objects(self.facts)
        orders = [] if self.orders is None else ["orders", str(self.orders.row)]
        text = "\n".join(["facts", *self.fact_names(), "timers", *rows, "used", *used, *orders])
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


VERSION = 1

DIGEST_BYTES = 8
MAX_NAME = 1_000
"""Longest name in a packed state, in characters; names of tasks are much shorter."""


class PackedState(NamedTuple):
    """Arguments of `World.restore`."""

    facts: int
    rows: tuple[TimerRow, ...]
    busy: tuple[BusyRow, ...]
    orders: Sequence[Any] | None = None


def packed(task: Task, state: PackedState) -> bytes:
    """Encode a state of a task."""
    facts = state.facts.to_bytes((state.facts.bit_length() + 7) // 8, "little")
    orders = () if state.orders is None else (state.orders,)
    found: bytes = msgpack.packb((VERSION, _mark(task), facts, state.rows, state.busy, *orders))
    return found


def unpacked(task: Task, data: bytes) -> PackedState:
    """Decode the result of `packed`; `World.restore` checks the contents.

    Raises:
        WrongArgumentError: The data is not a packed state, or has another version.
        WrongWorldError: The state belongs to another task.
    """
    try:
        version, mark, facts, rows, busy, *orders = msgpack.unpackb(data, use_list=False)
    except Exception as error:  # msgpack raises many unrelated types on bad input.
        raise WrongArgumentError(f"expected a packed state: {error}") from None
    if version != VERSION or not isinstance(facts, bytes):
        raise WrongArgumentError(f"expected a packed state of version {VERSION}, found {version!r}")
    if mark != _mark(task):
        raise WrongWorldError(f"the packed state is not of the task {task.name}")
    if not (_are(rows, _is_timer) and _are(busy, _is_busy)):
        raise WrongArgumentError("expected a packed state: its timers are invalid")
    if len(orders) > 1:
        raise WrongArgumentError("expected a packed state: it has too many fields")
    return PackedState(int.from_bytes(facts, "little"), rows, busy, *orders)


def _is_timer(row: tuple[Any, ...]) -> bool:
    action, index, arguments, counters = row
    return (
        _is_name(action)
        and isinstance(index, int)
        and _are(arguments, _is_name)
        and _are(counters, lambda counter: isinstance(counter, int))
    )


def _is_busy(row: tuple[Any, ...]) -> bool:
    player, steps = row
    return _is_name(player) and isinstance(steps, int)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= MAX_NAME


def _are(values: Any, kind: Callable[[Any], bool]) -> bool:
    """Return whether `values` is a tuple whose members are all of one kind."""
    try:
        return isinstance(values, tuple) and all(map(kind, values))
    except (TypeError, ValueError):  # A row is not a tuple, or has the wrong length.
        return False


def _mark(task: Task) -> Any:
    return bytes.fromhex(task.digest)[:DIGEST_BYTES]


ActionLike = GroundAction | str | None
"""Action of one player, the sentence of a valid one, or None for doing nothing."""

JointAction = ActionLike | Sequence[ActionLike] | Mapping[str, ActionLike]
"""One action, several in the order in which they apply, or one for each player."""

_EXPECTED = (
    "expected an action (`state.actions(player)` lists the valid ones), its sentence, None for "
    "nothing, a list of these, or a dict of them by player"
)


def in_order(
    joint: JointAction, players: Sequence[str]
) -> Iterator[tuple[str | None, GroundAction | str]]:
    """Yield the actions of a step, each with its player if a mapping names the player."""
    if isinstance(joint, GroundAction | str):
        yield None, joint
    elif isinstance(joint, Mapping):
        for player, action in joint.items():
            if player not in players:
                raise UnknownNameError.player(player, players)
            if action is not None:
                yield player, action
    elif isinstance(joint, Iterable):
        for action in joint:
            if action is not None:
                yield None, action
    elif joint is not None:
        raise WrongArgumentError(f"{_EXPECTED}; found {joint!r}")


def read(action: object, task: GroundTask, said: Callable[[str], GroundAction]) -> GroundAction:
    """Return the task's action for a sentence, or for an action of another world of the task."""
    if isinstance(action, GroundAction):
        return _own(action, task)
    if isinstance(action, str):
        return said(action)
    raise WrongArgumentError(f"{_EXPECTED}; found {action!r}")


def not_an_action(found: object) -> WrongArgumentError:
    """Return the error for an argument that is not an action."""
    return WrongArgumentError(
        f"expected an action, as world.action(name, *arguments) returns, found {found!r}"
    )


def _own(action: GroundAction, task: GroundTask) -> GroundAction:
    other = action.source.task
    if other.digest != task.task.digest:
        raise WrongWorldError(
            f"{action} belongs to another task, {other.name}; "
            f"ask this world: world.action({action.name!r}, *arguments)"
        )
    task.admit(action.arguments)
    return task.action(action.name, *action.arguments)
