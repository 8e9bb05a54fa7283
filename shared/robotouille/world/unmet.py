"""Why an action cannot be done, as values; their words are for people and language models.

`unmet_in` finds them, and an `Attempt` has them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import bound
from robotouille.world.text import describe
from robotouille.world.timers import Timers

__all__ = [
    "Attempt",
    "Unmet",
    "UnmetKind",
    "acted_already",
    "earlier_words",
    "from_words",
    "need",
    "only_words",
    "texts_of",
    "unmet_in",
]

NEEDS = "needs: "
MUST_NOT_BE = "must not be: "
EARLIER_NOT = "not: "


class UnmetKind(StrEnum):
    """What it is that does not hold. The values are on the wire."""

    CONDITION = "condition"
    """A precondition: `predicate` with `objects` should be `expected`, and is not."""
    MISSING = "missing"
    """An object does not exist (any more, or yet)."""
    BUSY = "busy"
    """The player cannot act before a delay of its own is over."""
    ACTED = "acted"
    """The player has acted in this step already."""
    TURN = "turn"
    """It is another player's turn."""
    SEAT = "seat"
    """The action moves another's player."""
    SUPERSEDED = "superseded"
    """The same seat has sent another action since."""
    OTHER = "other"
    """Something that only the words say."""


@dataclass(frozen=True, slots=True)
class Unmet:
    """One reason why an action cannot be done; `str()` gives its words."""

    kind: UnmetKind
    words: str
    predicate: str = ""
    objects: tuple[str, ...] = ()
    expected: bool = True

    def __str__(self) -> str:
        return self.words


class Attempt(NamedTuple):
    """What became of one player's action: applied, or rejected for what is `unmet`."""

    action: GroundAction
    applied: bool
    unmet: tuple[Unmet, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """What is unmet, in words."""
        return tuple(unmet.words for unmet in self.unmet)


def unmet_in(
    task: GroundTask, facts: int, timers: Timers, action: GroundAction, player: str | None
) -> tuple[Unmet, ...]:
    """What speaks against an action of a task in a state; empty if nothing.

    Args:
        task: The task, or world, that made the action.
        facts: `State.facts`.
        timers: `State.timers`.
        action: The action.
        player: Who would do it.
    """
    unmet = []
    steps = timers.busy_steps(player)
    if steps and player is not None:
        words = f"{player} is busy for {steps} more step{'s' * (steps > 1)}"
        unmet.append(Unmet(UnmetKind.BUSY, words, objects=(player,)))
    for name in action.arguments:
        there = task.table.bit.get((EXISTS, name))
        if there is not None and not facts & there:  # None: it is always there
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
    """What speaks against a player's second action in a step."""
    words = f"{player} has acted in this step already"
    return (Unmet(UnmetKind.ACTED, words, objects=(player,)),)


def only_words(*reasons: str) -> tuple[Unmet, ...]:
    """Reasons of which no more than the words are known."""
    return tuple(Unmet(UnmetKind.OTHER, words) for words in reasons)


def need(fact: str, expected: bool) -> str:
    """What an action needs, as something that cannot be read as what is so: `needs: robot1 stands
    at table1`, or `must not be: patty1 is cooking now`."""
    return f"{NEEDS if expected else MUST_NOT_BE}{fact}"


def earlier_words(words: str) -> str:
    """A reason as earlier versions said it, who named the fact alone; recordings have such."""
    if words.startswith(MUST_NOT_BE):
        return EARLIER_NOT + words.removeprefix(MUST_NOT_BE)
    return words.removeprefix(NEEDS)


def texts_of(reasons: Iterable[Unmet]) -> Iterator[str]:
    """Whatever is written where reasons are recorded: their words and, of more than those, their
    predicates and objects."""
    for reason in reasons:
        yield from (reason.words, reason.predicate, *reason.objects)


def from_words(*reasons: str) -> tuple[Unmet, ...]:
    """Reasons as recordings hold them, and messages of older servers: in words alone."""
    return tuple(map(_from_words, reasons))


_PHRASES = {
    UnmetKind.BUSY: re.compile(r"(\S+) is busy for \d+ more steps?"),
    UnmetKind.MISSING: re.compile(r"(\S+) does not exist"),
    UnmetKind.ACTED: re.compile(r"(\S+) has acted in this step already"),
    UnmetKind.TURN: re.compile(r"it is (\S+)'s turn"),
    UnmetKind.SEAT: re.compile(r"(\S+) is not yours to move: .*"),
    UnmetKind.SUPERSEDED: re.compile(r"superseded by action \d+"),
}


def _from_words(words: str) -> Unmet:
    for kind, phrase in _PHRASES.items():
        if found := phrase.fullmatch(words):
            return Unmet(kind, words, objects=found.groups())
    return Unmet(
        UnmetKind.CONDITION, words, expected=not words.startswith((MUST_NOT_BE, EARLIER_NOT))
    )
