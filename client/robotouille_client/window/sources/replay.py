"""A recording as a window's source, and what is seen and told at each of its steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from robotouille.episode import Controller
from robotouille.replay.controllers import Seating, seatings
from robotouille.replay.recording import Recording
from robotouille.replay.timeline import interludes
from robotouille.world.grounding.actions import GroundAction
from robotouille_client.window.sources.texts import outcome_words, won
from robotouille_client.window.view import SeatView, View

__all__ = ["NOTICE_SECONDS", "ReplaySource", "notices_at", "seats_at"]

NOTICE_SECONDS = 4.0
"""For how long what happened between two steps of a recording is told."""
NOT_PRESENT = (Controller.FREE, Controller.ABSENT, Controller.STAND_IN)


def seats_at(recording: Recording) -> list[tuple[SeatView, ...]]:
    """Who played each seat and what it had done by each step, from step 0 on."""
    bot = str(recording.header["rules"].get("stand_in", "bot"))
    done = {player: [0, 0] for player in recording.world.players}
    course = []
    start: dict[str, Any] = {"moves": []}
    for (_, seats), frame in zip(seatings(recording), [start, *recording.steps], strict=True):
        for i, move in enumerate(frame["moves"]):
            if move["player"] in done:
                done[move["player"]][str(i) in frame.get("unmet", {})] += 1
        course.append(
            tuple(
                _recorded_seat(player, seats[player], applied, rejected, bot)
                for player, (applied, rejected) in done.items()
            )
        )
    return course


def _recorded_seat(player: str, seat: Seating, applied: int, rejected: int, bot: str) -> SeatView:
    present = seat.controller not in NOT_PRESENT
    stand_in = bot if seat.controller == Controller.STAND_IN else ""
    return SeatView(player, seat.name, seat.kind, present, applied, rejected, stand_in)


def notices_at(recording: Recording, steps: int) -> dict[int, str]:
    """What to tell at which step, for `steps` steps each: announcements, pauses and restarts."""
    told: dict[int, str] = {}
    for step, words in interludes(recording):
        for later in range(step, step + max(1, steps)):
            told[later] = words if later > step or step not in told else f"{told[step]} · {words}"
    return told


class ReplaySource:
    """A recording, played at a speed or stepped through."""

    def __init__(self, recording: Recording, speed: float, now: Callable[[], float]) -> None:
        self._states = list(recording.states())
        self._recording = recording
        self._speed = speed
        self._now = now
        self._start = now()
        self._paused_at: float | None = None
        self._seats = seats_at(recording)
        self._notices = notices_at(recording, round(speed * NOTICE_SECONDS))

    def _position(self) -> float:
        if self._paused_at is not None:
            return self._paused_at
        return min(len(self._states) - 1.0, (self._now() - self._start) * self._speed)

    def pause(self) -> None:
        """Stop, or go on."""
        if self._paused_at is None:
            self._paused_at = self._position()
        else:
            self._start = self._now() - self._paused_at / self._speed
            self._paused_at = None

    def seek(self, steps: int) -> None:
        """Go some steps forward or back, and stay there."""
        position = round(self._position()) + steps
        self._paused_at = float(min(max(0, position), len(self._states) - 1))

    def view(self) -> View:
        position = self._position()
        index = min(len(self._states) - 1, int(position) + (position % 1 > 0))
        step, state = self._states[index]
        moving = self._paused_at is None and index > 0
        outcome = self._recording.outcome if index == len(self._states) - 1 else None
        return View(
            world=state.world,
            state=state,
            previous=self._states[index - 1][1] if index else None,
            step=step,
            max_steps=self._recording.header["rules"]["max_steps"],
            clock="replay" if moving else "replay, paused",
            phase=position % 1 or 1.0 if moving else 1.0,
            seats=self._seats[index],
            status="Space: pause or go on · Left, Right: step",
            outcome=outcome_words(outcome) if outcome else "",
            won=won(outcome),
            notice=self._notices.get(step, ""),
        )

    def act(self, action: GroundAction) -> None:
        pass

    def say(self, text: str) -> None:
        pass

    @property
    def finished(self) -> bool:
        return self._paused_at is None and self._position() >= len(self._states) - 1
