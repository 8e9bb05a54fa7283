"""What happened in an episode, step by step: what lanes, marks and the log are made of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from robotouille.episode.tallies import Activity
from robotouille.replay.timeline import Interlude
from robotouille.world.world import State, World
from robotouille_client.window.sources.playout import real_time_rate
from robotouille_client.window.view import SeatView

__all__ = [
    "ACTIVITIES",
    "DEFAULT_RATE",
    "UNSEEN",
    "Entry",
    "EntryKind",
    "History",
    "Mark",
    "recorded_rate",
]

DEFAULT_RATE = 5.0
"""Steps a second at which a game is seen again whose steps waited for decisions."""

ACTIVITIES = tuple(Activity)
"""A lane has one byte a step: the position of its activity here, or `UNSEEN`."""
UNSEEN = len(ACTIVITIES)
"""The byte of a step that nobody has told of."""
_CODES = {activity: code for code, activity in enumerate(ACTIVITIES)}


class EntryKind(StrEnum):
    """What sort of thing has happened."""

    ACTION = "action"
    REJECTED = "rejected"
    SUPERSEDED = "superseded"
    """A later action of the seat took its place."""
    SAID = "said"
    REASONING = "reasoning"
    SEAT = "seat"
    """Somebody came, went, or was back."""
    PAUSED = "paused"
    RESTARTED = "restarted"
    ANNOUNCED = "announced"
    ENDED = "ended"
    OTHER = "other"


MARKED = frozenset(EntryKind) - {
    EntryKind.ACTION, EntryKind.SUPERSEDED, EntryKind.SEAT, EntryKind.OTHER
}  # fmt: skip
"""What has a mark on the timeline."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Something that happened in a step, or after it and before the next one.

    `player` is whose it is, empty for what is nobody's. `reasons` say why something was rejected.
    """

    step: int
    kind: EntryKind
    player: str
    words: str
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Mark:
    """A place on the timeline that one may jump to."""

    step: int
    kind: EntryKind
    player: str = ""


class History(ABC):
    """An episode from step `first` to step `length`; it may grow at its end.

    `fault` says why it ends where it does, if something is wrong with it. `times` are milliseconds
    since the game began, by step. `interludes` are what whoever watches should be told, and after
    which step; `max_steps` is the limit that the game had, `rate` the steps a second at which it is
    seen again.
    """

    max_steps: int | None = None
    rate: float = DEFAULT_RATE

    def __init__(self, world: World) -> None:
        self.world = world
        self.lanes: dict[str, bytearray] = {player: bytearray() for player in world.players}
        self.marks: list[Mark] = []
        self.times = array("q", [0])
        self.first = 0
        self.fault = ""
        self.interludes: list[Interlude] = []
        self._said: list[tuple[int, str, str]] = []

    @property
    def length(self) -> int:
        """The number of steps."""
        return len(self.times) - 1

    @property
    @abstractmethod
    def outcome(self) -> Mapping[str, object] | None:
        """How it ended; None if it has no end."""

    @abstractmethod
    def state(self, step: int) -> State:
        """The state after a step.

        Raises:
            RobotouilleError: It cannot be told.
        """

    @abstractmethod
    def seats(self, step: int) -> tuple[SeatView, ...]:
        """Who played each seat in a step, and what it had done up to then."""

    @abstractmethod
    def entries(self, step: int) -> tuple[Entry, ...]:
        """What happened in a step and after it."""

    def activity(self, player: str, step: int) -> Activity | None:
        """What a seat did with a step, from 1 on; None if nobody has told."""
        code = self.lanes[player][step - 1]
        return None if code == UNSEEN else ACTIVITIES[code]

    def count(self, player: str, activity: Activity, step: int) -> int:
        """How many of the steps up to one a seat did something with."""
        return self.lanes[player].count(_CODES[activity], 0, step)

    def chat(self, step: int, lines: int) -> tuple[tuple[str, str], ...]:
        """The last lines said up to a step: name, empty for the operator, and text."""
        end = bisect_right(self._said, step, key=lambda line: line[0])
        return tuple((name, text) for _, name, text in self._said[max(0, end - lines) : end])

    def next_mark(self, step: int, player: str | None = None) -> Mark | None:
        """The first mark behind a step, of one player and of nobody only, if one is named."""
        start = bisect_right(self.marks, step, key=lambda mark: mark.step)
        return next((m for m in self.marks[start:] if player in (None, m.player)), None)

    def previous_mark(self, step: int, player: str | None = None) -> Mark | None:
        """The last mark before a step."""
        end = bisect_left(self.marks, step, key=lambda mark: mark.step)
        return next((m for m in reversed(self.marks[:end]) if player in (None, m.player)), None)

    def _add_step(self, time: int, did: Mapping[str, Activity]) -> None:
        """One more step, at a time in milliseconds; nothing is known of those who are left out."""
        for player, lane in self.lanes.items():
            lane.append(_CODES[did[player]] if player in did else UNSEEN)
        self.times.append(time)

    def _mark(self, entries: Iterable[Entry]) -> None:
        """Marks for what is worth one: one for each step, kind and player."""
        for entry in entries:
            if entry.kind not in MARKED:
                continue
            mark = Mark(entry.step, entry.kind, entry.player)
            if mark not in self.marks[-8:]:
                self.marks.append(mark)


def recorded_rate(rules: Mapping[str, Any]) -> float:
    """The steps a second of a game with some rules: those of its clock, where that has any."""
    return real_time_rate(rules) or DEFAULT_RATE
