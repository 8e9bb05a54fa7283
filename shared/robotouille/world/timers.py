"""The timers of a state as an automaton that is built while it is used.

A `Timers` value is the tuple of active effects with their counters, and how long each player is
still busy. What a step does to it depends only on itself and on the few atoms its effects read,
so every transition is computed once (by `EffectRun`) and looked up afterwards. Transitions that
create or delete objects depend on more, and are computed anew each time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

from robotouille.errors import UnknownNameError, WrongArgumentError, WrongWorldError, did_you_mean
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.effects import DONE, HOLDING, Effect, EffectRun
from robotouille.world.grounding.ground_task import GroundTask

__all__ = ["BusyRow", "Change", "Progress", "TimerRow", "TimerTable", "Timers"]

TimerRow = tuple[str, int, tuple[str, ...], tuple[int, ...]]
"""An active effect: its action, its number there, its arguments, its counters."""
BusyRow = tuple[str, int]
"""A player who is walking or working, and for how many more steps."""

Entry = tuple[Effect, tuple[int, ...]]
Key = tuple[tuple[Entry, ...], int | None, int]
"""Active effects, the serial of the action that is performed, and the atoms they read."""

MAX_KEPT = 50_000
"""Transitions that a world knows; then it learns anew."""


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


class Change(NamedTuple):
    """What an update does: `facts = (facts | touched) ^ removed`, and the timers after it."""

    touched: int
    removed: int
    timers: Timers


class TimerOutcome(NamedTuple):
    """What an update does to the effects alone, and whether it depends only on what they read."""

    touched: int
    removed: int
    entries: tuple[Entry, ...]
    repeatable: bool


class Timers:
    """Active effects in order of creation with their counters; equal values are one object."""

    __slots__ = ("__weakref__", "busy", "entries", "reads", "started", "table", "ticked")

    def __init__(
        self, table: TimerTable, entries: tuple[Entry, ...], busy: tuple[BusyRow, ...]
    ) -> None:
        self.table = table
        self.entries = entries
        self.busy = busy
        self.reads = 0
        for effect, _ in entries:
            self.reads |= effect.reads
        self.ticked: dict[int, Change] = {}
        self.started: dict[tuple[int, int], Change] = {}

    def __bool__(self) -> bool:
        return bool(self.entries or self.busy)

    def busy_steps(self, player: str | None) -> int:
        """For how many more steps a player cannot act."""
        for name, steps in self.busy:
            if name == player:
                return steps
        return 0

    def rows(self) -> tuple[TimerRow, ...]:
        """The active effects as `(action, index, arguments, counters)`, in order of creation."""
        return tuple((*effect.label, progress) for effect, progress in self.entries)

    def progress(self) -> tuple[Progress, ...]:
        """All that time or work is bringing about, in order of creation: a patty that cooks."""
        return tuple(
            Progress(
                action=effect.label[0],
                arguments=effect.label[2],
                subject=node.subject,
                done=counters[node.slot],
                total=node.total,
                running=effect.root.kind != "conditional" or counters[0] == HOLDING,
                timed=node.kind == "delayed",
            )
            for effect, counters in self.entries
            for node in effect.counters()
            if counters[node.slot] >= 0
        )

    def begin(self, action: GroundAction, facts: int) -> Change:
        """Start an action's effects, or give them an active update."""
        if action.source is not self.table.source:
            raise WrongWorldError(
                f"{action} was made by another World; ask this one: "
                f"world.action({action.name!r}, *arguments)"
            )
        key = (action.serial, facts & (action.reads | self.reads))
        change = self.started.get(key)
        if change is None:
            change, repeatable = self.table.begin(self, action, facts)
            if repeatable:
                self.table.make_room()
                self.started[key] = change
        return change

    def tick(self, facts: int) -> Change:
        """The passive update that ends a step."""
        change = self.ticked.get(facts & self.reads)
        if change is None:
            change, repeatable = self.table.tick(self, facts)
            if repeatable:
                self.table.make_room()
                self.ticked[facts & self.reads] = change
        return change

    def forget(self) -> None:
        """Know no transition any more; they are computed again where they are needed."""
        self.ticked.clear()
        self.started.clear()


class TimerTable:
    """Hands out one `Timers` per value and performs the updates that are not yet known."""

    def __init__(self, source: GroundTask) -> None:
        self.source = source
        self._known: WeakValueDictionary[tuple[tuple[Entry, ...], tuple[BusyRow, ...]], Timers] = (
            WeakValueDictionary()
        )
        self._outcomes: dict[Key, TimerOutcome] = {}
        self._transitions = 0
        self.none = self.get((), ())

    def get(self, entries: tuple[Entry, ...], busy: tuple[BusyRow, ...]) -> Timers:
        """The one `Timers` of this value."""
        key = (entries, busy)
        timers = self._known.get(key)
        if timers is None:
            timers = self._known[key] = Timers(self, entries, busy)
        return timers

    def restored(self, rows: Iterable[TimerRow], busy: Iterable[BusyRow]) -> Timers:
        """The `Timers` of `Timers.rows()` and of those who are busy, from elsewhere.

        Raises:
            UnknownNameError: A row speaks of an action, object or player that the task has not.
            WrongWorldError: A row cannot be of this task.
            WrongArgumentError: These are no rows.
        """
        entries = []
        for action, index, arguments, counters in _checked(rows, 4):
            effect = self.source.effect(action, index, tuple(arguments))
            if len(counters) != effect.size:
                raise WrongWorldError(f"{effect} has {effect.size} counters, found {len(counters)}")
            entries.append((effect, tuple(counters)))
        busy = tuple(_checked(busy, 2))
        if busy:
            _check_busy(busy, self.source.players)
        return self.get(tuple(entries), busy)

    def make_room(self) -> None:
        """One more transition is about to be kept."""
        if self._transitions >= MAX_KEPT:
            self.forget()
        self._transitions += 1

    def forget(self) -> None:
        """Know no transition any more."""
        self._transitions = 0
        self._outcomes.clear()
        for reference in self._known.valuerefs():
            if (timers := reference()) is not None:
                timers.forget()

    def begin(self, timers: Timers, action: GroundAction, facts: int) -> tuple[Change, bool]:
        """What starting an action's effects does, and whether it always does that."""
        busy = timers.busy
        if action.player is not None and action.duration > 1:
            busy = tuple(sorted({**dict(busy), action.player: action.duration}.items()))
        key = (timers.entries, action.serial, facts & (action.reads | timers.reads))
        shared = bool(busy)
        return self._change(key, busy, shared, lambda: self._begin(timers.entries, action, facts))

    def tick(self, timers: Timers, facts: int) -> tuple[Change, bool]:
        """What the passive update of all effects does, and whether it always does that."""
        busy = tuple((name, steps - 1) for name, steps in timers.busy if steps > 1)
        key = (timers.entries, None, facts & timers.reads)
        shared = bool(timers.busy)
        return self._change(key, busy, shared, lambda: self._tick(timers.entries, facts))

    def _change(
        self,
        key: Key,
        busy: tuple[BusyRow, ...],
        shared: bool,
        work_out: Callable[[], TimerOutcome],
    ) -> tuple[Change, bool]:
        """Effects do the same whoever is busy: where somebody is, that is worked out once."""
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
        """Add what a creation or deletion has started; drop what is about a deleted object."""
        active = {effect for effect, _ in entries}
        for effect in run.started:
            if effect not in active:
                active.add(effect)
                entries.append((effect, effect.start))
        run.started.clear()
        if run.deleted:
            entries[:] = [entry for entry in entries if not run.concerns_deleted(entry[0])]

    def _outcome(self, run: EffectRun, entries: list[Entry]) -> TimerOutcome:
        repeatable = not run.written & self.source.table.internal
        return TimerOutcome(run.written, run.written & ~run.facts, tuple(entries), repeatable)


def _checked(rows: Any, length: int) -> list[Any]:
    """Rows of timers or of busy players, each a tuple of so many values."""
    try:
        found = [tuple(row) for row in rows]
    except TypeError:
        raise WrongArgumentError(f"expected rows of a state's timers, found {rows!r}") from None
    if any(len(row) != length for row in found):
        raise WrongWorldError(f"expected rows of {length} values, found {found}")
    return found


def _check_busy(busy: tuple[BusyRow, ...], players: tuple[str, ...]) -> None:
    if len(busy) > len(players):
        raise WrongWorldError(f"{len(busy)} are busy of {len(players)} players")
    for player, steps in busy:
        if player not in players:
            raise UnknownNameError(f"no player {player!r}{did_you_mean(player, players)}")
        if not (isinstance(steps, int) and steps > 0):
            raise WrongWorldError(f"{player} is busy for {steps!r} steps")
