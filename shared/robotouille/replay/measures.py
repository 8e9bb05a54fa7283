"""Measures of an episode, for the team and for each seat, and the meaning of single notes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from robotouille.episode.events import ACTION_INVALID, RejectionKind
from robotouille.episode.lifecycle import Controller
from robotouille.episode.rules import Clock
from robotouille.episode.tallies import Activity, activity
from robotouille.errors import RecordingError
from robotouille.replay.frame_schema import Frames, FrameSource
from robotouille.world.unmet import unmet_from


@dataclass(frozen=True, slots=True)
class StepActivity:
    """Activity of each seat in a step (`did`), and the remaining steps of busy players (`busy`)."""

    did: Mapping[str, Activity]
    busy: Mapping[str, int]


def activities(recording: Frames) -> Iterator[tuple[int, StepActivity]]:
    """Yield the number of each step and the seats' activities in it.

    Raises:
        RecordingError: A note has an unknown controller.
    """
    players = recording.world.players
    by_turns = False
    busy: Mapping[str, int] = {}
    controllers = dict.fromkeys(players, Controller.FREE)
    refused: set[str] = set()
    for frame in recording.each_frame(states=False):
        if frame["kind"] == "header":
            by_turns = frame["rules"]["clock"] == Clock.TURN
        elif frame["kind"] == "state":
            busy = frame["busy"]
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                _seat_note(note, controllers, refused)
        elif frame["kind"] == "step":
            turn = players[(frame["step"] - 1) % len(players)] if by_turns else None
            yield frame["step"], _judged(frame, controllers, busy, refused, turn)
            busy = frame.get("busy", busy)
            refused.clear()


def _seat_note(
    note: Mapping[str, Any], controllers: dict[str, Controller], refused: set[str]
) -> None:
    """Update the controllers and the seats that had a rejected request."""
    if note["note"] == "roster" and note["player"] in controllers:
        controllers[note["player"]] = controller_of(note)
        if not note["taken"]:
            refused.discard(note["player"])
    elif note["note"] == "rejected" and note["player"] in controllers:
        if rejection_kind(note) is not RejectionKind.SUPERSEDED:
            refused.add(note["player"])
    elif note["note"] == "started":
        refused.clear()


def _judged(
    frame: Mapping[str, Any],
    controllers: Mapping[str, Controller],
    busy: Mapping[str, int],
    refused: set[str],
    turn: str | None,
) -> StepActivity:
    lost, waits = frame.get("unmet", {}), frozenset(frame.get("waits", ()))
    applied = {move["player"]: str(i) not in lost for i, move in enumerate(frame["moves"])}
    did = {
        player: activity(
            controller,
            applied.get(player),
            busy.get(player, 0) > 0,
            player in refused or player in waits,
            turn is not None and turn != player,
        )
        for player, controller in controllers.items()
    }
    # The same pure function classifies steps during play, so steps store no activities
    # (docs/decisions/0032).
    return StepActivity(did, busy)


@dataclass(frozen=True, slots=True)
class SeatMeasures:
    """Measures of one seat. Except for the activities, a substitute's actions are not counted.

    The fields from `acted` to `substituted` are numbers of steps; see `Activity`.

    Attributes:
        name: Name of the last participant; empty if nobody had the seat.
        kind: Kind of the last participant.
        lost: Actions that were valid on arrival and failed in their step.
        said: Chat messages.
        thinking: Seconds that the seat took to decide, in total.
        staleness: Mean number of steps between the state of a choice and the state in which the
            action was taken, over the actions with a recorded basis; None without such actions.
        rejected: Number of rejected requests by kind; see `robotouille.episode.RejectionKind`.
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
        """Number of steps for each activity. They sum to the steps of the episode."""
        return {each.value: getattr(self, each.value) for each in Activity}

    @property
    def all_rejected(self) -> dict[str, int]:
        """Number of rejections by kind, with `lost`. Those beyond the quota are missing."""
        return {**self.rejected, **({"lost": self.lost} if self.lost else {})}

    @property
    def invalid(self) -> int:
        """Number of actions whose preconditions did not hold on arrival."""
        return self.rejected.get("invalid", 0)

    @property
    def malformed(self) -> int:
        """Number of texts that named no action."""
        return self.rejected.get("malformed", 0)


@dataclass(frozen=True, slots=True)
class Measures:
    """Measures of an episode.

    Attributes:
        success: True if the goal was reached.
        reason: Reason for the end; empty before the end.
        seconds: Time from the start to the last step, pauses included.
    """

    task: str
    clock: str
    success: bool
    reason: str
    steps: int
    seconds: float
    seats: Mapping[str, SeatMeasures]


def measures(recording: FrameSource) -> Measures:
    """Return the measures of an episode, which may still be in progress.

    Raises:
        RecordingError: The task has no such action, or the action moves another player.
    """
    world = recording.world
    tallies: dict[str, Counter[str]] = {player: Counter() for player in world.players}
    people = dict.fromkeys(world.players, ("", ""))
    clock, steps, milliseconds, reason = "", 0, 0, ""
    for frame in recording.each_frame(states=False):
        if frame["kind"] == "header":
            clock = frame["rules"]["clock"]
        elif frame["kind"] == "step":
            steps, milliseconds = frame["step"], frame["t"]
            recording.actions(frame)  # Raises if a move is not the player's own.
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
    for place, move in enumerate(step["moves"]):
        if move["seq"] == 0:  # A substitute's move.
            continue
        tally = tallies[move["player"]]
        tally.update({"lost": int(str(place) in step.get("unmet", {})), "ms": move["ms"]})
        if "basis" in move:
            tally.update({"based": 1, "stale": step["step"] - 1 - move["basis"]})


def _note(
    notes: Iterable[Mapping[str, Any]],
    tallies: Mapping[str, Counter[str]],
    people: dict[str, tuple[str, str]],
) -> None:
    for note in notes:
        if note["note"] == "roster" and note["name"] and note["player"] in people:
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


def rejection_kind(note: Mapping[str, Any]) -> RejectionKind:
    """Return the kind of a `rejected` note."""
    reasons = unmet_from(note["reasons"], note.get("why", ()))
    code, heard = note.get("code", ACTION_INVALID), note.get("heard", True)
    # The function used during play computes the kind, because recordings do not store it.
    return RejectionKind.of(code, reasons, heard=heard)


def rejections(recording: FrameSource) -> dict[str, Counter[RejectionKind]]:
    """Count each player's rejected requests by kind. The recording need not have an end."""
    counts: dict[str, Counter[RejectionKind]] = {
        player: Counter() for player in recording.world.players
    }
    for note in recording.notes():
        if note["note"] == "rejected" and note["player"] in counts:
            counts[note["player"]][rejection_kind(note)] += 1
    return counts


def controller_of(note: Mapping[str, Any]) -> Controller:
    """Return the controller in a `roster` note.

    Raises:
        RecordingError: The controller is unknown.
    """
    try:
        return Controller(note["controller"])
    except ValueError as error:
        raise RecordingError(str(error)) from None
