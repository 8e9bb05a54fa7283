"""How an episode went, in numbers: for the team, and for each seat."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from robotouille.episode.events import RejectionKind
from robotouille.episode.tallies import Activity
from robotouille.replay.analysis.activities import activities
from robotouille.replay.frame_schema import FrameSource
from robotouille.replay.notes import rejections

__all__ = ["Measures", "SeatMeasures", "measures"]


@dataclass(frozen=True, slots=True)
class SeatMeasures:
    """One seat.

    `name` and `kind` are its last participant's (empty: nobody's). Each step is one of those in
    which it `acted`, was `busy`, `waiting`, `idle`, `away` or `substituted`
    (`robotouille.episode.Activity`). All else is about its participants alone, without a stand-in.
    `lost` actions were valid when they came, and no more when their turn in the step came.
    `rejected` counts what was taken into no step by kind (`robotouille.episode.RejectionKind`):
    `invalid`, `malformed`, `superseded`, `unheard`. `said` are chat messages. `thinking` are the
    seconds that its moves took, all together. `staleness` is the mean number of steps between the
    state that an action was based on and the one in which it was taken, of those whose basis is
    recorded; None if there are none.
    """

    name: str = ""
    kind: str = ""
    acted: int = 0
    busy: int = 0
    waiting: int = 0
    idle: int = 0
    away: int = 0
    substituted: int = 0
    lost: int = 0
    said: int = 0
    thinking: float = 0.0
    staleness: float | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)

    @property
    def activities(self) -> dict[str, int]:
        """How many steps were what (`robotouille.episode.Activity`); they sum to the steps."""
        return {each.value: getattr(self, each.value) for each in Activity}

    @property
    def invalid(self) -> int:
        """Known actions that were not valid when they were asked for."""
        return self.rejected.get("invalid", 0)

    @property
    def malformed(self) -> int:
        """What was no action at all."""
        return self.rejected.get("malformed", 0)


@dataclass(frozen=True, slots=True)
class Measures:
    """An episode.

    `reason` is why it ended, empty while it has not; `success` says that the goal was reached.
    `seconds` are those from the beginning to the last step, pauses included.
    """

    task: str
    clock: str
    success: bool
    reason: str
    steps: int
    seconds: float
    seats: Mapping[str, SeatMeasures]


def measures(recording: FrameSource) -> Measures:
    """The measures of an episode, which may still be going on.

    Raises:
        RecordingError: A step has an action that the task has not, or one of another player's.
    """
    world = recording.world
    tallies: dict[str, Counter[str]] = {player: Counter() for player in world.players}
    people = dict.fromkeys(world.players, ("", ""))
    clock, steps, milliseconds, reason = "", 0, 0, ""
    for frame in recording.each_frame():
        if frame["kind"] == "header":
            clock = frame["rules"]["clock"]
        elif frame["kind"] == "step":
            steps, milliseconds = frame["step"], frame["t"]
            recording.actions(frame)  # Only those of the seats are counted.
            _count(frame, tallies)
        elif frame["kind"] == "notes":
            _note(frame["notes"], tallies, people)
        elif frame["kind"] == "footer":
            reason = frame["outcome"]["reason"]
    for _, step in activities(recording):
        for player, did in step.did.items():
            tallies[player][did.value] += 1
    rejected = rejections(recording)
    seats = {p: _seat(*people[p], tallies[p], rejected[p]) for p in world.players}
    success, seconds = reason == "goal", milliseconds / 1000
    return Measures(world.task.name, clock, success, reason, steps, seconds, seats)


def _count(step: Mapping[str, Any], tallies: Mapping[str, Counter[str]]) -> None:
    """How the moves of a step came about; those of stand-ins have no sequence number."""
    for place, move in enumerate(step["moves"]):
        if move["seq"] == 0:
            continue
        tally = tallies[move["player"]]
        tally.update({"lost": str(place) in step.get("unmet", {}), "ms": move["ms"]})
        if "basis" in move:
            tally.update({"based": 1, "stale": step["step"] - 1 - move["basis"]})


def _note(
    notes: Iterable[Mapping[str, Any]],
    tallies: Mapping[str, Counter[str]],
    people: dict[str, tuple[str, str]],
) -> None:
    """Who sat down, and who said something."""
    for note in notes:
        if note["note"] == "roster" and note["name"]:
            people[note["player"]] = note["name"], note["kind"]
        elif note["note"] == "said" and note["player"] in tallies:
            tallies[note["player"]]["said"] += 1


def _seat(
    name: str, kind: str, tally: Mapping[str, int], rejected: Mapping[RejectionKind, int]
) -> SeatMeasures:
    return SeatMeasures(
        name,
        kind,
        **{each.value: tally[each.value] for each in Activity},
        lost=tally["lost"],
        said=tally["said"],
        thinking=tally["ms"] / 1000,
        staleness=tally["stale"] / tally["based"] if tally["based"] else None,
        rejected={kind.value: number for kind, number in rejected.items()},
    )
