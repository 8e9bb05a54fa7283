"""Where a window's pictures come from: a game in this process, or a recording.

None of these draws; time is passed in as a function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from robotouille.episode import (
    Controller,
    Ended,
    Episode,
    Phase,
    Rejected,
    Said,
    Stepped,
)
from robotouille.errors import ProtocolError
from robotouille.planning.policies.policy import Policy
from robotouille.replay.controllers import Seating, seatings
from robotouille.replay.recording import Recording
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.state import State
from robotouille_client.cli.timeline import interludes
from robotouille_client.window.chat_log import ChatLog
from robotouille_client.window.pause_texts import clock_words, outcome_words
from robotouille_client.window.view import SeatView, View

__all__ = [
    "GLIDE_SECONDS",
    "NOTICE_SECONDS",
    "LocalSource",
    "ReplaySource",
    "notices_at",
    "seats_at",
]

GLIDE_SECONDS = 0.3
"""For how long a step is seen where no clock says how long it takes."""
NOTICE_SECONDS = 4.0
"""For how long what happened between two steps of a recording is told."""
NOT_PRESENT = (Controller.FREE, Controller.ABSENT, Controller.STAND_IN)


class LocalSource:
    """An episode in this process; bots play the seats of others."""

    def __init__(
        self,
        episode: Episode,
        me: str,
        bots: Mapping[str, tuple[str, Policy]],
        now: Callable[[], float],
    ) -> None:
        self._episode = episode
        self._me = me
        self._bots = bots
        self._now = now
        self._talk = ChatLog(now)
        self._previous: State | None = None
        self._seq: dict[str, int] = dict.fromkeys(episode.world.players, 0)
        self._step_time = now()
        self._decided = dict.fromkeys(bots, -1)
        episode.join(me, "you", "human", now())
        for player, (name, _) in bots.items():
            episode.join(player, name, "bot", now())

    def view(self) -> View:
        self._episode.tick(self._now())
        self._let_bots_move()
        self._take_events()
        episode = self._episode
        rules = episode.rules
        scheduled = rules.scheduled
        elapsed = self._now() - self._step_time
        outcome = episode.outcome
        return View(
            world=episode.world,
            state=episode.state,
            previous=self._previous,
            step=episode.step,
            max_steps=rules.max_steps,
            clock=clock_words(rules.clock.value, rules.model_dump(mode="json")),
            phase=min(1.0, elapsed / (rules.period if scheduled else GLIDE_SECONDS)),
            seats=tuple(
                SeatView(s.player, s.name, s.kind, s.present, s.tally.applied, s.tally.rejected)
                for s in episode.seats.values()
            ),
            me=self._me,
            bubbles=self._talk.bubbles,
            chat=self._talk.lines,
            status=self._status(),
            outcome=outcome_words(outcome.to_json()) if outcome else "",
        )

    def _status(self) -> str:
        turn = self._episode.on_turn
        if turn is None:
            return ""
        return "Your turn" if turn == self._me else f"{turn}'s turn"

    def _let_bots_move(self) -> None:
        """At most one bot thinks in a frame, so that the window stays smooth."""
        episode = self._episode
        for player, (_, policy) in self._bots.items():
            may = episode.on_turn in (None, player) and not episode.state.busy_steps(player)
            if episode.phase is Phase.RUNNING and may and self._decided[player] < episode.step:
                self._decided[player] = episode.step
                self._submit(player, policy.act(episode.state))
                return

    def _submit(self, player: str, action: GroundAction | None) -> None:
        self._seq[player] += 1
        try:
            self._episode.submit(player, self._seq[player], action, self._now())
        except ProtocolError as error:
            self._talk.refused(player, (error.message,))

    def _take_events(self) -> None:
        for event in self._episode.events():
            match event:
                case Stepped():
                    self._previous, self._step_time = event.before, self._now()
                    did = [
                        (move.player, move.action, attempt.applied)
                        for move, attempt in zip(event.moves, event.attempts, strict=True)
                    ]
                    for player, (_, policy) in self._bots.items():
                        policy.observe(did)
                        self._decided[player] = min(self._decided[player], event.step - 1)
                case Rejected():
                    self._talk.refused(event.player, event.reasons)
                case Said():
                    self._talk.said(event.name, event.player, event.text)
                case Ended():
                    self._step_time = self._now()
                case _:
                    pass

    def act(self, action: GroundAction) -> None:
        self._submit(self._me, action)

    def say(self, text: str) -> None:
        self._episode.say("you", self._me, text, self._now())

    @property
    def finished(self) -> bool:
        return self._episode.phase is Phase.ENDED


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
            notice=self._notices.get(step, ""),
        )

    def act(self, action: GroundAction) -> None:
        pass

    def say(self, text: str) -> None:
        pass

    @property
    def finished(self) -> bool:
        return self._paused_at is None and self._position() >= len(self._states) - 1
