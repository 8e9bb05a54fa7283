"""What each seat did with each step of a recording, from its frames alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from robotouille.episode.events import RejectionKind
from robotouille.episode.lifecycle import Controller
from robotouille.episode.rules import Clock
from robotouille.episode.tallies import Activity, activity
from robotouille.replay.frame_schema import FrameSource
from robotouille.replay.notes import controller_after, rejection_kind

__all__ = ["StepActivity", "activities"]


@dataclass(frozen=True, slots=True)
class StepActivity:
    """What the seats `did` with a step, by player, and for how many steps from its beginning on
    those who were `busy` could not act."""

    did: Mapping[str, Activity]
    busy: Mapping[str, int]


def activities(recording: FrameSource) -> Iterator[tuple[int, StepActivity]]:
    """The number of each step, from 1 on, with what the seats did in it.

    Raises:
        RecordingError: A note names somebody who cannot move a seat.
    """
    players = recording.world.players
    by_turns = False
    busy: Mapping[str, int] = {}
    controllers = dict.fromkeys(players, Controller.FREE)
    refused: set[str] = set()
    for frame in recording.each_frame():
        if frame["kind"] == "header":
            by_turns = frame["rules"]["clock"] == Clock.TURN
        elif frame["kind"] == "state":
            busy = frame["busy"]
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                _note(note, controllers, refused)
        elif frame["kind"] == "step":
            turn = players[(frame["step"] - 1) % len(players)] if by_turns else None
            yield frame["step"], _judged(frame, controllers, busy, refused, turn)
            busy = frame.get("busy", busy)
            refused.clear()


def _note(note: Mapping[str, Any], controllers: dict[str, Controller], refused: set[str]) -> None:
    """Who moves the seats from a note on, and whom something was refused."""
    if note["note"] == "roster" and note["player"] in controllers:
        controllers[note["player"]] = controller_after(note)
        if not note.get("taken", True):
            refused.discard(note["player"])
    elif note["note"] == "rejected" and rejection_kind(note) is not RejectionKind.SUPERSEDED:
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
    lost = frame.get("unmet", {})
    applied = {move["player"]: str(i) not in lost for i, move in enumerate(frame["moves"])}
    did = {
        player: activity(
            controller,
            applied.get(player),
            busy.get(player, 0) > 0,
            player in refused or player in frame.get("waits", ()),
            turn is not None and turn != player,
        )
        for player, controller in controllers.items()
    }
    return StepActivity(did, busy)
