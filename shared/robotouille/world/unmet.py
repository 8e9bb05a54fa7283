"""Reasons why an action is rejected, as values with words for people and language models."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import bound
from robotouille.world.text import describe
from robotouille.world.timers import Timers

NEEDS = "needs: "
MUST_NOT_BE = "must not be: "


class UnmetKind(StrEnum):
    """Kind of a reason. The values are part of the protocol and of recordings."""

    CONDITION = "condition"
    """A precondition is unmet: `predicate` of `objects` is not `expected`."""
    MISSING = "missing"
    """An object does not exist now."""
    BUSY = "busy"
    """The player is still walking or working."""
    ACTED = "acted"
    """The player has already acted in this step."""
    TURN = "turn"
    """It is another player's turn."""
    SEAT = "seat"
    """The action moves the player of another seat."""
    SUPERSEDED = "superseded"
    """The same seat sent another action later."""
    STALE = "stale"
    """The action is outdated, or based on a state that is older than it allows."""
    UNKNOWN = "unknown"
    """The text or name is not an action of the task."""
    OTHER = "other"
    """Another reason, described by the words alone."""


WORDED = frozenset({UnmetKind.OTHER, UnmetKind.STALE, UnmetKind.UNKNOWN})
"""Kinds of reasons without a predicate and objects. Recordings have their words and code only."""


@dataclass(frozen=True, slots=True)
class Unmet:
    """One reason why an action is rejected; `str()` returns its words."""

    kind: UnmetKind
    words: str
    predicate: str = ""
    objects: tuple[str, ...] = ()
    expected: bool = True

    def __str__(self) -> str:
        return self.words


class Attempt(NamedTuple):
    """Result of one player's action: applied, or rejected for the reasons in `unmet`."""

    action: GroundAction
    applied: bool
    unmet: tuple[Unmet, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons in words."""
        return tuple(unmet.words for unmet in self.unmet)


def unmet_in(
    task: GroundTask, facts: int, timers: Timers, action: GroundAction, player: str | None
) -> tuple[Unmet, ...]:
    """Return the reasons against an action of a task in a state; empty if it applies.

    `facts` and `timers` are those of the state. `player` would take the action.
    """
    unmet = []
    steps = timers.busy_steps(player)
    if steps and player is not None:
        words = f"{player} is busy for {steps} more step{'s' * (steps > 1)}"
        unmet.append(Unmet(UnmetKind.BUSY, words, objects=(player,)))
    for name in action.arguments:
        there = task.table.bit.get((EXISTS, name))
        if there is not None and not facts & there:  # None: it always exists.
            unmet.append(Unmet(UnmetKind.MISSING, f"{name} does not exist", objects=(name,)))
    binding = action.schema.bind(action.arguments)
    for condition in action.schema.definition.precons:
        atom = bound(condition, binding)
        if task.table.holds(atom, facts) != condition.is_true:
            words = need(describe(task.task.domain, atom), condition.is_true)
            kind, (predicate, *objects) = UnmetKind.CONDITION, atom
            unmet.append(Unmet(kind, words, predicate, tuple(objects), condition.is_true))
    return tuple(unmet)


def acted_already(player: str) -> tuple[Unmet, ...]:
    """Return the reason against a player's second action in a step."""
    words = f"{player} has already acted in this step"
    return (Unmet(UnmetKind.ACTED, words, objects=(player,)),)


def only_words(*reasons: str, kind: UnmetKind = UnmetKind.OTHER) -> tuple[Unmet, ...]:
    """Return reasons that consist of words alone."""
    return tuple(Unmet(kind, words) for words in reasons)


def need(fact: str, expected: bool) -> str:
    """Return a precondition in words, such as `needs: robot1 stands at table1`.

    The prefix keeps language models from reading an unmet condition as a fact.
    """
    return f"{NEEDS if expected else MUST_NOT_BE}{fact}"


def texts_of(reasons: Iterable[Unmet]) -> Iterator[str]:
    """Yield every text of some reasons that ends up in a recording."""
    for reason in reasons:
        yield from (reason.words, reason.predicate, *reason.objects)


def unmet_from(words: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> tuple[Unmet, ...]:
    """Return reasons from their words and the rows that recordings store beside them.

    Reasons without rows, or of a kind that this version does not know, are `OTHER`.
    """
    if len(words) != len(rows):
        return only_words(*words)
    return tuple(map(_unmet_from, words, rows))


def _unmet_from(words: str, row: Mapping[str, Any]) -> Unmet:
    known = row["kind"] in set(UnmetKind)
    return Unmet(
        UnmetKind(row["kind"]) if known else UnmetKind.OTHER,
        words,
        row.get("predicate", ""),
        tuple(row.get("objects", ())),
        row.get("expected", True),
    )
