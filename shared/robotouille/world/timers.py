"""Timers of a state, as an automaton whose transitions are computed on first use.

A `Timers` value holds the active effects with their counters, and how long each player is still
busy. The result of an update depends only on that value and on the few atoms that the effects read.
So `EffectRun` computes each transition once, and later updates look it up. Transitions that create
or delete objects depend on more of the state and are computed every time
(docs/decisions/0002-timers-as-an-automaton.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

from robotouille.errors import UnknownNameError, WrongArgumentError, WrongWorldError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.effects import DONE, HOLDING, Effect, EffectRun
from robotouille.world.grounding.ground_task import GroundTask

TimerRow = tuple[str, int, tuple[str, ...], tuple[int, ...]]
"""Active effect: its action, its index in the action, its arguments, its counters."""
BusyRow = tuple[str, int]
"""Player who is walking or working, and the steps that are left."""

Entry = tuple[Effect, tuple[int, ...]]
Key = tuple[tuple[Entry, ...], int | None, int]
"""Active effects, the serial number of the performed action, and the atoms that they read."""

# A planner may visit millions of states. At the bound the caches are emptied, which costs only
# time.
MAX_KEPT = 50_000
"""Transitions that a world caches."""


class Progress(NamedTuple):
    """Progress of a counting effect: `done` of `total` steps or performances of `action`.

    `running` is false while the effect is paused, such as the cooking of a patty that was taken off
    its stove. `timed` is true if time completes the effect, and false if repeated work does.
    """

    action: str
    arguments: tuple[str, ...]
    subject: str
    done: int
    total: int
    running: bool
    timed: bool = True


class Change(NamedTuple):
    """Result of an update: `facts = (facts | touched) ^ removed`, and the timers after it."""

    touched: int
    removed: int
    timers: Timers


class TimerOutcome(NamedTuple):
    """Result of an update for the effects; `repeatable` if it depends only on the atoms read."""

    touched: int
    removed: int
    entries: tuple[Entry, ...]
    repeatable: bool


class Timers:
    """Active effects with their counters, in order of creation; equal values are one object.

    `pending` is false if nothing changes with time, so that steps skip `tick`. It is the truth
    value, too; in hot loops the attribute is faster.
    """

    __slots__ = ("__weakref__", "busy", "entries", "pending", "reads", "started", "table", "ticked")

    def __init__(
        self, table: TimerTable, entries: tuple[Entry, ...], busy: tuple[BusyRow, ...]
    ) -> None:
        self.table = table
        self.entries = entries
        self.busy = busy
        # Most steps have neither, and one attribute is faster than two.
        self.pending = bool(entries or busy)
        self.reads = 0
        for effect, _ in entries:
            self.reads |= effect.reads
        self.ticked: dict[int, Change] = {}
        self.started: dict[tuple[int, int], Change] = {}

    def __bool__(self) -> bool:
        return self.pending

    # A tuple and not a dictionary: at most a few players are busy, and the value must be hashable.
    def busy_steps(self, player: str | None) -> int:
        """Return for how many more steps a player cannot act."""
        for name, steps in self.busy:
            if name == player:
                return steps
        return 0

    def rows(self) -> tuple[TimerRow, ...]:
        """Return the active effects in order of creation."""
        return tuple((*effect.label, progress) for effect, progress in self.entries)

    def progress(self) -> tuple[Progress, ...]:
        """Return the progress of all counting effects, in order of creation."""
        return tuple(
            Progress(
                action=effect.label[0],
                arguments=effect.label[2],
                subject=node.subject,
                done=counters[node.slot],
                total=node.total,
                running=not effect.root.pauses or counters[0] == HOLDING,
                timed=node.counts == "steps",
            )
            for effect, counters in self.entries
            for node in effect.counters()
            if counters[node.slot] >= 0
        )

    def begin(self, action: GroundAction, facts: int) -> Change:
        """Start an action's effects, or give running ones an active update."""
        if action.source is not self.table.source:
            raise WrongWorldError(
                f"{action} was made by another World; ask this one: "
                f"world.action({action.name!r}, *arguments)"
            )
        # The serial number and not the action: a small integer is cheaper to hash.
        key = (action.serial, facts & (action.reads | self.reads))
        change = self.started.get(key)
        if change is None:
            change, repeatable = self.table.begin(self, action, facts)
            if repeatable:
                self.table.make_room()
                self.started[key] = change
        return change

    def tick(self, facts: int) -> Change:
        """Perform the passive update that ends a step."""
        change = self.ticked.get(facts & self.reads)
        if change is None:
            change, repeatable = self.table.tick(self, facts)
            if repeatable:
                self.table.make_room()
                self.ticked[facts & self.reads] = change
        return change

    def forget(self) -> None:
        """Drop the cached transitions."""
        self.ticked.clear()
        self.started.clear()


class TimerTable:
    """Interns `Timers` values and computes the transitions that are not cached yet."""

    def __init__(self, source: GroundTask) -> None:
        self.source = source
        # Weak values: a `Timers` lives as long as a state refers to it, and its caches with it.
        self._known: WeakValueDictionary[tuple[tuple[Entry, ...], tuple[BusyRow, ...]], Timers] = (
            WeakValueDictionary()
        )
        self._outcomes: dict[Key, TimerOutcome] = {}
        self._transitions = 0
        self.none = self.get((), ())

    def get(self, entries: tuple[Entry, ...], busy: tuple[BusyRow, ...]) -> Timers:
        """Return the `Timers` object of this value."""
        key = (entries, busy)
        timers = self._known.get(key)
        if timers is None:
            timers = self._known[key] = Timers(self, entries, busy)
        return timers

    def restored(self, rows: Iterable[TimerRow], busy: Iterable[BusyRow]) -> Timers:
        """Return the `Timers` for rows that come from outside this process.

        Raises:
            UnknownNameError: A row names an unknown action, object or player.
            WrongWorldError: A row does not fit the task.
            WrongArgumentError: The values are not rows.
        """
        entries = []
        for action, index, arguments, counters in _checked(rows, 4):
            effect = self.source.effect(action, index, tuple(arguments))
            # Rows may come from a file or the network, so nothing about them is trusted.
            if len(counters) != effect.size:
                raise WrongWorldError(f"{effect} has {effect.size} counters, found {len(counters)}")
            entries.append((effect, tuple(counters)))
        busy = tuple(_checked(busy, 2))
        if busy:
            _check_busy(busy, self.source.players)
        return self.get(tuple(entries), busy)

    def make_room(self) -> None:
        """Count one more cached transition, and empty the caches when they are full."""
        if self._transitions >= MAX_KEPT:
            self.forget()
        self._transitions += 1

    def forget(self) -> None:
        """Drop all cached transitions."""
        self._transitions = 0
        self._outcomes.clear()
        for reference in self._known.valuerefs():
            if (timers := reference()) is not None:
                timers.forget()

    def begin(self, timers: Timers, action: GroundAction, facts: int) -> tuple[Change, bool]:
        """Start an action's effects; the flag says whether the result may be cached."""
        busy = timers.busy
        if action.player is not None and action.duration > 1:
            busy = tuple(sorted({**dict(busy), action.player: action.duration}.items()))
        key = (timers.entries, action.serial, facts & (action.reads | timers.reads))
        shared = bool(busy)
        return self._change(key, busy, shared, lambda: self._begin(timers.entries, action, facts))

    def tick(self, timers: Timers, facts: int) -> tuple[Change, bool]:
        """Update all effects passively; the flag says whether the result may be cached."""
        busy = tuple((name, steps - 1) for name, steps in timers.busy if steps > 1)
        key = (timers.entries, None, facts & timers.reads)
        # Without busy players, the caches of `Timers` themselves are enough.
        shared = bool(timers.busy)
        return self._change(key, busy, shared, lambda: self._tick(timers.entries, facts))

    def _change(
        self,
        key: Key,
        busy: tuple[BusyRow, ...],
        shared: bool,
        work_out: Callable[[], TimerOutcome],
    ) -> tuple[Change, bool]:
        # Busy counters multiply the `Timers` values, but effects do not read them. So transitions
        # with busy players are also cached here by the effects alone.
        outcome = self._outcomes.get(key) if shared else None
        if outcome is None:
            outcome = work_out()
            if outcome.repeatable and shared:
                self.make_room()
                self._outcomes[key] = outcome
        timers = self.get(outcome.entries, busy)
        return Change(outcome.touched, outcome.removed, timers), outcome.repeatable

    def _begin(self, before: tuple[Entry, ...], action: GroundAction, facts: int) -> TimerOutcome:
        run = self.source.effect_run(facts)
        entries = list(before)
        # In the order of the domain file: an early effect may create or delete what a later one
        # reads. An effect that already runs gets an active update instead of a second instance.
        for effect in action.effects:
            if run.concerns_deleted(effect):
                continue
            place = next((i for i, (e, _) in enumerate(entries) if e is effect), None)
            if place is None:
                place = len(entries)
                entries.append((effect, effect.start))
            entries[place] = (effect, run.update(effect, entries[place][1], active=True))
            self._settle(run, entries)
        return self._outcome(run, entries)

    def _tick(self, before: tuple[Entry, ...], facts: int) -> TimerOutcome:
        run = self.source.effect_run(facts)
        entries = [
            (effect, run.update(effect, progress, active=False))
            for effect, progress in before
            if not run.concerns_deleted(effect)
        ]
        self._settle(run, entries)
        return self._outcome(run, [(e, progress) for e, progress in entries if progress[0] != DONE])

    def _settle(self, run: EffectRun, entries: list[Entry]) -> None:
        """Add the effects that a creation or deletion started; drop those of deleted objects."""
        active = {effect for effect, _ in entries}
        for effect in run.started:
            if effect not in active:
                active.add(effect)
                entries.append((effect, effect.start))
        run.started.clear()
        if run.deleted:
            entries[:] = [entry for entry in entries if not run.concerns_deleted(entry[0])]

    def _outcome(self, run: EffectRun, entries: list[Entry]) -> TimerOutcome:
        # Internal atoms say which objects exist. A run that wrote one depends on free names.
        repeatable = not run.written & self.source.table.internal
        return TimerOutcome(run.written, run.written & ~run.facts, tuple(entries), repeatable)


def _checked(rows: Any, length: int) -> list[Any]:
    """Return rows of timers or busy players as tuples, each of `length` values."""
    try:
        found = [tuple(row) for row in rows]
    except TypeError:
        raise WrongArgumentError(f"expected rows of a state's timers, found {rows!r}") from None
    if any(len(row) != length for row in found):
        raise WrongWorldError(f"expected rows of {length} values, found {found}")
    return found


def _check_busy(busy: tuple[BusyRow, ...], players: tuple[str, ...]) -> None:
    if len(busy) > len(players):
        raise WrongWorldError(f"{len(busy)} players are busy, but the task has {len(players)}")
    for player, steps in busy:
        if player not in players:
            raise UnknownNameError.player(player, players)
        if not (isinstance(steps, int) and steps > 0):
            raise WrongWorldError(f"{player} cannot be busy for {steps!r} steps")
