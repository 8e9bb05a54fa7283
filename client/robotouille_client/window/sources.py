"""Where a window's pictures come from: a server, a game in this process, or a recording.

None of these draws; time is passed in as a function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from robotouille.episode import (
    Ended,
    Episode,
    Phase,
    Rejected,
    Said,
    Stepped,
)
from robotouille.errors import ProtocolError
from robotouille.replay.recording import Recording
from robotouille.world.actions import GroundAction
from robotouille.world.state import State
from robotouille_client.bots.policies import Policy
from robotouille_client.game import Changed, Game, Heard, Over, Refused
from robotouille_client.window.view import Bubble, SeatView, View

__all__ = ["LocalSource", "RemoteSource", "ReplaySource", "outcome_words", "seats_at"]

BUBBLE_SECONDS = 3.0
GLIDE_SECONDS = 0.3
CHAT_LINES = 6

REASONS = {
    "goal": "Goal reached",
    "step_limit": "Out of steps",
    "abandoned": "Everybody left",
    "aborted": "Stopped",
}


def outcome_words(outcome: Mapping[str, object]) -> str:
    """`Goal reached in 31 steps`."""
    reason = REASONS.get(str(outcome["reason"]), str(outcome["reason"]))
    link = "in" if outcome["reason"] == "goal" else "after"
    detail = f": {outcome['detail']}" if outcome.get("detail") else ""
    return f"{reason} {link} {outcome['steps']} steps{detail}"


class Talk:
    """What was said and refused lately, and by whom."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._bubbles: list[tuple[float, Bubble]] = []
        self._lines: list[tuple[str, str]] = []

    def refused(self, player: str, reasons: tuple[str, ...]) -> None:
        if any(reason.startswith("superseded") for reason in reasons):
            return
        self._add(Bubble.rejection(player, reasons))

    def said(self, name: str, player: str, text: str) -> None:
        self._lines.append((name, text))
        if player:
            self._add(Bubble(player, text, "chat"))

    def _add(self, bubble: Bubble) -> None:
        kept = [(t, b) for t, b in self._bubbles if b.player != bubble.player]
        self._bubbles = [*kept, (self._now(), bubble)]

    @property
    def bubbles(self) -> tuple[Bubble, ...]:
        now = self._now()
        return tuple(b for t, b in self._bubbles if now - t < BUBBLE_SECONDS)

    @property
    def lines(self) -> tuple[tuple[str, str], ...]:
        return tuple(self._lines[-CHAT_LINES:])


class RemoteSource:
    """An episode on a server, through a `Game`."""

    def __init__(
        self, game: Game, now: Callable[[], float], connected: Callable[[], bool] = lambda: True
    ) -> None:
        self._game = game
        self._connected = connected
        self._now = now
        self._talk = Talk(now)
        self._previous: State | None = None
        self._reason = ""

    def view(self) -> View:
        game = self._game
        for event in game.poll():
            match event:
                case Changed():
                    self._previous = event.previous
                    self._show_rejections(event)
                case Refused() if game.seat:
                    self._talk.refused(game.seat, event.reasons)
                case Heard():
                    self._talk.said(event.name, event.seat, event.text)
                case Over():
                    self._reason = event.reason
                case _:
                    pass
        return View(
            world=game.world,
            state=game.state,
            previous=self._previous,
            step=game.step,
            max_steps=game.clock.get("max_steps"),
            clock=_clock_words(str(game.clock.get("clock", "")), game.clock),
            phase=self._phase(),
            seats=tuple(
                SeatView(s.player, s.name, s.kind, s.present, s.applied, s.rejected)
                for s in game.seats
            ),
            me=game.seat,
            bubbles=self._talk.bubbles,
            chat=self._talk.lines,
            status=self._status(),
            code=game.code,
            outcome=outcome_words(game.outcome) if game.outcome else "",
        )

    def _show_rejections(self, event: Changed) -> None:
        for player, action, applied in event.did:
            if not applied:
                self._talk.refused(player, (f"too late: {action.sentence}",))

    def _phase(self) -> float:
        elapsed = self._now() - self._game.step_time
        scheduled = self._game.clock.get("clock") == "realtime"
        period = 1 / self._game.clock["step_rate"] if scheduled else GLIDE_SECONDS
        return min(1.0, max(0.0, elapsed / period))

    def _status(self) -> str:
        game = self._game
        if game.ended and not game.outcome:
            return f"Disconnected: {self._reason}"
        if not self._connected():
            return "Connection lost, trying again …"
        if game.phase == "waiting":
            free = sum(not seat.name for seat in game.seats)
            return f"Waiting for {free} more player{'s' * (free != 1)}"
        if game.turn is not None:
            return "Your turn" if game.turn == game.seat else f"{game.turn}'s turn"
        return ""

    def act(self, action: GroundAction) -> None:
        if self._game.running:
            self._game.submit(action)

    def say(self, text: str) -> None:
        self._game.say(text)

    @property
    def finished(self) -> bool:
        return self._game.ended


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
        self._talk = Talk(now)
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
            clock=_clock_words(rules.clock.value, rules.model_dump(mode="json")),
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
        return self._episode.phase is Phase.OVER


def seats_at(recording: Recording) -> list[tuple[SeatView, ...]]:
    """Who played each seat and what it had done by each step, from step 0 on."""
    people = recording.participants
    done = {player: [0, 0] for player in recording.world.players}
    course = []
    start: dict[str, Any] = {"moves": []}
    for frame in [start, *recording.steps]:
        for i, move in enumerate(frame["moves"]):
            if move["player"] in done:
                done[move["player"]][str(i) in frame.get("unmet", {})] += 1
        course.append(
            tuple(
                SeatView(player, *people.get(player, ("", "")), True, applied, rejected)
                for player, (applied, rejected) in done.items()
            )
        )
    return course


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
        )

    def act(self, action: GroundAction) -> None:
        pass

    def say(self, text: str) -> None:
        pass

    @property
    def finished(self) -> bool:
        return self._paused_at is None and self._position() >= len(self._states) - 1


def _clock_words(clock: str, rules: Mapping[str, object]) -> str:
    if clock == "realtime":
        return f"real time, {rules['step_rate']:g} steps a second"
    budget = rules.get("move_budget")
    return f"{clock}, {budget:g} s a move" if budget else clock
