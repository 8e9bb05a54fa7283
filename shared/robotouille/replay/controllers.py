"""Who moved each seat in each step of a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from robotouille.replay.notes import controller_after
from robotouille.replay.recording import Recording

__all__ = ["Seating", "Span", "controllers", "seating_after", "seatings", "spans"]


@dataclass(frozen=True, slots=True)
class Seating:
    """Whose seat it is (`name` is empty: nobody's) and who moves it."""

    name: str = ""
    kind: str = ""
    controller: str = ""


@dataclass(frozen=True, slots=True)
class Span:
    """The steps from `first` to `last`, in which a seat was one participant's and had one
    controller."""

    player: str
    name: str
    controller: str
    first: int
    last: int


def controllers(recording: Recording) -> dict[int, dict[str, str]]:
    """The controller of every player in each step, by the step's number, from 1 on.

    `human`, `bot`, `model`: the seat's participant; `absent`: nobody, for as long as the
    participant was away; `stand-in`: a bot in an absent one's place; empty: the seat was free.

    An action that was sent before a connection was lost is still taken while the seat is `absent`
    or a `stand-in`'s: its sequence number is above 0, that of a stand-in's action is 0.
    """
    return {
        step: {player: seating.controller for player, seating in seats.items()}
        for step, seats in seatings(recording)
        if step > 0
    }


def spans(recording: Recording) -> dict[str, list[Span]]:
    """For each player, the stretches of steps that one controller moved it."""
    found: dict[str, list[Span]] = {player: [] for player in recording.world.players}
    for step, seats in seatings(recording):
        if step == 0:
            continue
        for player, seating in seats.items():
            course, name, controller = found[player], seating.name, seating.controller
            if course and (course[-1].name, course[-1].controller) == (name, controller):
                course[-1] = replace(course[-1], last=step)
            else:
                course.append(Span(player, name, controller, step, step))
    return found


def seatings(recording: Recording) -> Iterator[tuple[int, Mapping[str, Seating]]]:
    """The seats before the first step (as step 0), then in each step."""
    seats: dict[str, Seating] = dict.fromkeys(recording.world.players, Seating())
    begun = False
    for frame in recording.each_frame():
        if frame["kind"] == "notes":
            seats = {**seats, **dict(_changes(frame["notes"], seats))}
        elif frame["kind"] == "step":
            if not begun:
                yield 0, seats
            begun = True
            yield frame["step"], seats
    if not begun:
        yield 0, seats


def _changes(
    notes: list[dict[str, Any]], seats: Mapping[str, Seating]
) -> Iterator[tuple[str, Seating]]:
    for note in notes:
        if note["note"] == "roster" and note["player"] in seats:
            yield note["player"], seating_after(note)


def seating_after(note: Mapping[str, Any]) -> Seating:
    """A seat as a `roster` note leaves it.

    Raises:
        RecordingError: It names a controller that is not known.
    """
    name = note["name"] if note.get("taken", True) else ""
    return Seating(name, note["kind"], controller_after(note).value)
