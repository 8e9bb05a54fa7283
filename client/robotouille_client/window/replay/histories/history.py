"""History of a game, step by step, from which lanes, marks and the log are drawn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from robotouille.domain.rendering import Language
from robotouille.episode.tallies import Activity
from robotouille.errors import RobotouilleError
from robotouille.replay.rates import DEFAULT_RATE
from robotouille.replay.timeline import Interlude
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.wording import Wording
from robotouille.world.unmet import Unmet, unmet_from
from robotouille.world.world import State, World
from robotouille_client.window.view import Bubble, SeatView


class HistoryWording:
    """Words for a world's actions and reasons, in one language."""

    def __init__(self, world: World, language: Language) -> None:
        self._world = world
        self._language = language

    def move(self, action: Sequence[str], state: State, names: Mapping[str, str]) -> str:
        """Return a recorded action in words. Unknown actions keep their name and arguments."""
        try:
            return self.action(self._world.action(*action), state, names)
        except (RobotouilleError, TypeError):
            return " ".join(action)

    def action(self, action: GroundAction, state: State, names: Mapping[str, str]) -> str:
        """Return an action in words, in the state in which it was taken."""
        return self._wording(names).action(action, state)

    def attempt(self, note: Mapping[str, Any], state: State, names: Mapping[str, str]) -> str:
        """Return the rejected action of a note in words, or its text if it is not an action."""
        try:
            action = self._world.parse(state, note["player"], note["action"], valid=False)
        except RobotouilleError:
            return str(note.get("text") or note["action"])
        return self.action(action, state, names)

    def reasons(
        self,
        words: Sequence[str],
        why: Sequence[Mapping[str, Any]],
        state: State,
        names: Mapping[str, str],
    ) -> tuple[str, ...]:
        """Return reasons in words; recorded words are used if the recording has no values."""
        return self.unmet(unmet_from(words, why), state, names)

    def unmet(
        self, unmet: Sequence[Unmet], state: State, names: Mapping[str, str]
    ) -> tuple[str, ...]:
        """Return unmet conditions in words."""
        wording = self._wording(names)
        return tuple(wording.reason(each, state) for each in unmet)

    def _wording(self, names: Mapping[str, str]) -> Wording:
        return Wording(self._world, self._language, None, names)


# Activities by code. A lane has one byte for each step: such a code, or `UNSEEN`.
ACTIVITIES = tuple(Activity)
# Code of a step about which nothing is known.
UNSEEN = len(ACTIVITIES)
_CODES = {activity: code for code, activity in enumerate(ACTIVITIES)}


class EntryKind(StrEnum):
    """Kind of event in a history."""

    ACTION = "action"
    REJECTED = "rejected"
    SUPERSEDED = "superseded"
    """A later action of the seat replaced it."""
    SAID = "said"
    REASONING = "reasoning"
    SEAT = "seat"
    """A participant joined, left or returned."""
    PAUSED = "paused"
    RESTARTED = "restarted"
    ANNOUNCED = "announced"
    ENDED = "ended"
    OTHER = "other"


# Marks of a timeline. A recording can have millions of events.
MAX_MARKS = 100_000

# Kinds that get a mark on the timeline.
MARKED = frozenset(EntryKind) - {
    EntryKind.ACTION, EntryKind.SUPERSEDED, EntryKind.SEAT, EntryKind.OTHER
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Entry:
    """Event in a step, or between it and the next one.

    Attributes:
        player: Player of the event; empty if it is about no player.
        reasons: Why an action was rejected.
        target: Object at which a signal points.
    """

    step: int
    kind: EntryKind
    player: str
    words: str
    reasons: tuple[str, ...] = ()
    target: str = ""


@dataclass(frozen=True, slots=True)
class Mark:
    """Place on the timeline to jump to."""

    step: int
    kind: EntryKind
    player: str = ""


class History(ABC):
    """Game from step `first` to step `length`, which may still grow.

    Attributes:
        fault: Why the history ends early, if it is damaged.
        times: Milliseconds since the game started, by step.
        interludes: Events between steps that spectators are shown.
        max_steps: Step limit of the game.
        rate: Steps a second for the replay.
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
        """Number of steps."""
        return len(self.times) - 1

    @property
    @abstractmethod
    def outcome(self) -> Mapping[str, object] | None:
        """End of the game; None if it has no end."""

    @abstractmethod
    def state(self, step: int) -> State:
        """Return the state after a step.

        Raises:
            RobotouilleError: The state cannot be read.
        """

    @abstractmethod
    def seats(self, step: int) -> tuple[SeatView, ...]:
        """Return who played each seat in a step, and what the seat had done by then."""

    @abstractmethod
    def entries(self, step: int) -> tuple[Entry, ...]:
        """Return the events in a step and after it."""

    def activity(self, player: str, step: int) -> Activity | None:
        """Return what a seat did in a step (from 1), or None if that is unknown."""
        code = self.lanes[player][step - 1]
        return None if code == UNSEEN else ACTIVITIES[code]

    def count(self, player: str, activity: Activity, step: int) -> int:
        """Count the steps up to `step` with an activity of a seat."""
        return self.lanes[player].count(_CODES[activity], 0, step)

    def chat(self, step: int, lines: int) -> tuple[tuple[str, str], ...]:
        """Return the last chat lines up to a step as (name, text); the operator's name is empty."""
        end = bisect_right(self._said, step, key=lambda line: line[0])
        return tuple((name, text) for _, name, text in self._said[max(0, end - lines) : end])

    def next_mark(self, step: int, player: str | None = None) -> Mark | None:
        """Return the first mark after a step, of a player or of nobody only, if one is named."""
        start = bisect_right(self.marks, step, key=lambda mark: mark.step)
        return next((m for m in self.marks[start:] if player in (None, m.player)), None)

    def previous_mark(self, step: int, player: str | None = None) -> Mark | None:
        """Return the last mark before a step."""
        end = bisect_left(self.marks, step, key=lambda mark: mark.step)
        return next((m for m in reversed(self.marks[:end]) if player in (None, m.player)), None)

    def _add_step(self, time: int, did: Mapping[str, Activity]) -> None:
        """Add a step at a time in milliseconds. The activity of players not in `did` is unknown."""
        for player, lane in self.lanes.items():
            lane.append(_CODES[did[player]] if player in did else UNSEEN)
        self.times.append(time)

    def _mark(self, entries: Iterable[Entry]) -> None:
        """Add marks for events, one for each step, kind and player."""
        for entry in entries:
            if entry.kind not in MARKED or len(self.marks) >= MAX_MARKS:
                continue
            mark = Mark(entry.step, entry.kind, entry.player)
            # Marks come in the order of steps, so that equal ones are among the newest.
            if mark not in self.marks[-8:]:
                self.marks.append(mark)


# Seconds for which a replay shows what happened between two steps.
NOTICE_SECONDS = 4.0


BUBBLE_STEPS = 3


CHAT_LINES = 6


def bubbles_at(history: History, step: int) -> tuple[Bubble, ...]:
    """Return the newest bubble of each player, from a step and the two before."""
    found = []
    for near in range(max(0, step - BUBBLE_STEPS + 1), step + 1):
        for entry in history.entries(near):
            if entry.kind is EntryKind.SAID and entry.player:
                found.append(Bubble(entry.player, entry.words, "chat", target=entry.target))
            elif entry.kind is EntryKind.REJECTED:
                found.append(Bubble.rejection(entry.player, next(iter(entry.reasons), "")))
    return tuple({bubble.player: bubble for bubble in found}.values())


MAX_NOTICE = 500
"""Characters of the notices of a step. A recording can have 300,000 notices after one step."""


def notices_at(interludes: list[Interlude], steps: int) -> dict[int, str]:
    """Return notices by step: announcements for `steps` steps, pauses until the game goes on."""
    groups: dict[int, list[Interlude]] = {}
    for interlude in interludes:
        groups.setdefault(interlude.step, []).append(interlude)
    notices: dict[int, str] = {}
    lasting, end, after = "", 0, 0
    for step in sorted(groups):
        notices.update(dict.fromkeys(range(after, min(step, end)), lasting))
        words = [lasting] if step < end else []
        words += (interlude.words for interlude in groups[step])
        notices[step] = _cut(" · ".join(words))
        for interlude in groups[step]:
            if interlude.lasts:
                lasting, end = _cut(interlude.words), step + max(1, steps)
        after = step + 1
    return notices | dict.fromkeys(range(after, end), lasting)


def _cut(words: str) -> str:
    return words if len(words) <= MAX_NOTICE else f"{words[:MAX_NOTICE]}…"
