"""Bots with seats, the schedule on which they act, and the moves that they repeat."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import cache
from math import ceil, inf

from robotouille import World
from robotouille.episode.rules import Clock
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State
from robotouille_client.loadtest.participant import Environment, Participant, RawMessage

NamedMove = dict[str, str | list[str]]
"""An action as in the protocol."""
SETTLED = 5
"""Number of deltas after which the estimate is used."""
WATCHED = 50
"""Number of deltas with at least one that is less than half a period late."""


class StepSchedule:
    """The due times of an episode's steps, estimated on the client's clock.

    A delta does not contain the time at which its step was due, but steps are due at a fixed rate.
    The earliest arrival for its step is therefore taken as punctual: `transit` seconds after the
    step was due. All ages are relative to this best delivery.

    A server that is too far behind may give up its schedule and continue from a later time. The
    estimate notices this when `WATCHED` deltas in a row are late by half a period. These count as
    late, the estimate starts over, and `given_up` increases by one.
    """

    __slots__ = ("_least", "_origin", "_period", "_seen", "_transit", "_watched", "given_up")

    def __init__(self, rate: float, transit: float = 0.0) -> None:
        self._period = 1 / rate
        self._transit = transit
        self.given_up = 0
        self.restart()

    def restart(self) -> None:
        """Forget the estimate, after the episode was paused."""
        self._origin = inf
        self._seen = 0
        self._reset_watch()

    def _reset_watch(self) -> None:
        self._watched = 0
        self._least = inf

    @property
    def settled(self) -> bool:
        """True if enough deltas have arrived for the estimate to be used."""
        return self._seen >= SETTLED

    def arrived(self, step: int, at: float) -> float:
        """Record the arrival of a step's delta and return its age in seconds."""
        origin = at - self._transit - step * self._period
        self._origin = min(self._origin, origin)
        self._seen += 1
        late = origin - self._origin
        self._watch(origin, late)
        return late + self._transit

    def _watch(self, origin: float, late: float) -> None:
        self._watched += 1
        self._least = min(self._least, late)
        if self._watched >= WATCHED:
            if self._least > self._period / 2:
                self.given_up += 1
                self._origin = origin
            self._reset_watch()

    def due(self, step: int) -> float:
        """Return the time at which a step is due."""
        return self._origin + step * self._period

    def next_due(self, at: float) -> float:
        """Return the time of the first step that is due at or after `at`."""
        return self.due(ceil((at - self._origin) / self._period))


class Player(Participant):
    """A bot with a seat. Subclasses decide what it does."""

    def __init__(self, environment: Environment, name: str, clock: Clock) -> None:
        super().__init__(environment, name)
        self.clock = clock
        self.playing = False
        self.on_over: Callable[[], None] = _nothing
        self.on_interrupted: Callable[[], None] = _nothing
        self._complete = False
        self._number = 0
        self._turn: str | None = None
        self._seq = 0
        self._missed = 0
        self._episode: str | None = None
        self._step = 0

    def seated(self, joined: RawMessage) -> None:
        self._seq = joined.get("seq", 0)
        self._missed = joined.get("step", 0)
        self._episode = joined["episode"]

    def interrupted(self) -> None:
        self.on_interrupted()

    async def return_to_seat(self) -> RawMessage:
        self.saw(self._episode, self._step)
        return await super().return_to_seat()

    def heard(self, message: RawMessage) -> None:
        kind = message["type"]
        if kind == "delta":
            self._turn = message.get("turn")
            self._step = message["step"]
            if self._step > self._missed:
                self.stepped(message)
            else:
                self.environment.measured.count("missed deltas sent again")
        elif kind == "snapshot":
            self._seq = max(self._seq, message.get("seq", 0))
            self._step = message["step"]
            self.settled(message.get("last_seq", 0))
            self._look(message)
        elif kind == "roster":
            self._look(message)
        elif kind == "rejected":
            self.rejected(message)
        elif kind == "ended":
            self.playing = False
            self.on_over()

    def _look(self, message: RawMessage) -> None:
        self._turn = message.get("turn")
        self.playing = message.get("phase") == "running"
        self._complete = all(seat.get("present") for seat in message["seats"])
        names = [seat["player"] for seat in message["seats"]]
        self._number = names.index(self.seat) if self.seat in names else 0
        self.looked()

    def looked(self) -> None:
        """Handle a snapshot or roster."""

    def stepped(self, delta: RawMessage) -> None:
        """Handle a step."""

    def settled(self, seq: int) -> None:
        """Handle a snapshot, which decides all actions up to this sequence number."""

    def rejected(self, message: RawMessage) -> None:
        """Handle the rejection of an action."""

    def act(self, action: NamedMove | None) -> int:
        """Send an action and return its sequence number."""
        self._seq += 1
        self.send({"type": "act", "seq": self._seq, "action": action})
        return self._seq


class Bystander(Player):
    """Bot that decides at once to do nothing. In real time it only watches."""

    def __init__(self, environment: Environment, name: str, clock: Clock) -> None:
        super().__init__(environment, name, clock)
        self._decided = False

    def stepped(self, delta: RawMessage) -> None:
        self._decided = False
        self._decide()

    def looked(self) -> None:
        self._decide()

    def seated(self, joined: RawMessage) -> None:
        super().seated(joined)
        self._decided = False

    def _decide(self) -> None:
        # With an empty seat, idle decisions would let steps follow one another without a pause.
        if self.clock is Clock.REALTIME or self._decided or not (self.playing and self._complete):
            return
        if self.clock is Clock.LOCKSTEP or self._turn == self.seat:
            self._decided = True
            self.act(None)


class Actor(Player):
    """Bot that moves back and forth at a fixed rate, whatever happens to earlier actions.

    Its durations begin when an action is due, not when it can be sent. An action that waits for
    the previous answer is late from its own due time, so a server that stalls is not measured
    less often (coordinated omission). In real time, all actions that became due during a wait are
    one action, since a step takes only one.
    """

    def __init__(
        self,
        environment: Environment,
        name: str,
        clock: Clock,
        rate: float,
        moves: tuple[NamedMove, NamedMove],
    ) -> None:
        super().__init__(environment, name, clock)
        self._period = 1 / rate
        self._moves = moves
        self._place = 0
        self._unanswered: list[float] = []
        self._asked = 0
        self._schedule = StepSchedule(rate, environment.transit)
        self._next_due = 0.0
        self._begun = False
        self._timer: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()

    def stop(self) -> None:
        """Stop the schedule while the bot is away or the episode is paused."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._begun = False
        self._unanswered.clear()
        self._schedule.restart()

    def measure(self) -> None:
        """Drop the schedule's history before the measured time."""
        if self.clock is Clock.REALTIME:
            self.stop()

    def cut(self) -> None:
        self.stop()
        super().cut()

    def close(self) -> None:
        self.stop()
        super().close()

    def interrupted(self) -> None:
        self.stop()
        super().interrupted()

    # Messages

    def looked(self) -> None:
        if not self.playing:
            self.stop()
        elif self.clock is not Clock.REALTIME:
            self._begin(self._loop.time())
        self._catch_up()

    def stepped(self, delta: RawMessage) -> None:
        now = self._loop.time()
        if self.clock is Clock.REALTIME:
            self._note_step(delta["step"], now)
        if "seq" in delta and self._unanswered:
            self._answer(delta, now)
        self._catch_up()

    def _note_step(self, step: int, now: float) -> None:
        given_up = self._schedule.given_up
        age = self._schedule.arrived(step, now)
        self.environment.measured.count("steps")
        if self._schedule.given_up > given_up:
            self.environment.measured.count("schedules given up by the server")
        if self._schedule.settled:
            self.environment.measured.took("delta age", age)
            if self.playing:
                self._begin(self._schedule.next_due(now))

    def _answer(self, delta: RawMessage, now: float) -> None:
        for place, (row, seq) in enumerate(zip(delta["did"], delta["seq"], strict=True)):
            if row[0] == self._number:
                if str(place) not in delta.get("unmet", ()):
                    self._place = 1 - self._place
                if seq >= self._asked:
                    self._note_answer(now)

    def settled(self, seq: int) -> None:
        if self._unanswered and seq >= self._asked:
            self._note_answer(self._loop.time())

    def _note_answer(self, now: float) -> None:
        took = self.environment.measured.took
        dues, self._unanswered = self._unanswered, []
        for due in dues:
            if self.clock is Clock.REALTIME:
                took("action with its wait, realtime", now - due)
                took("action, realtime", max(0.0, now - self._schedule.next_due(due)))
            else:
                took(f"action, {self.clock.value}", now - due)

    def rejected(self, message: RawMessage) -> None:
        code = message.get("code", "action/invalid")
        self.environment.measured.count(f"rejected: {code}")
        if message["seq"] < self._asked or not self._unanswered:
            return
        self._unanswered.clear()
        if code == "action/invalid":
            self._place = 1 - self._place
        self._catch_up()

    # Actions

    def _begin(self, base: float) -> None:
        # In the middle of a step, so that small errors of the estimate do not move an action into
        # the next step.
        if not self._begun:
            self._begun = True
            phase = self.environment.rng.uniform(0.25, 0.75)
            self._next_due = base + phase * self._period
            self._wait()

    def _wait(self) -> None:
        self._timer = self._loop.call_at(self._next_due, self._on_time)

    def _on_time(self) -> None:
        self._timer = None
        self._catch_up()

    def _catch_up(self) -> None:
        # If nothing may be sent now, the next answer calls this method again.
        if self._timer is not None or not self._may_act():
            return
        now = self._loop.time()
        dues: list[float] = []
        while self._next_due <= now and (not dues or self.clock is Clock.REALTIME):
            dues.append(self._next_due)
            self._next_due += self._period
        if dues:
            self._asked = self.act(self._moves[self._place])
            self.environment.measured.count("actions")
            self._unanswered = dues
        else:
            self._wait()

    def _may_act(self) -> bool:
        if not (
            self._begun and self.playing and not self._unanswered and self.connection is not None
        ):
            return False
        return self.clock is not Clock.TURN or self._turn == self.seat


def _nothing() -> None:
    pass


@cache
def back_and_forth(task: str, player: str) -> tuple[NamedMove, NamedMove]:
    """Return an action that is valid at the start of a task, and the action that undoes it.

    Raises:
        RobotouilleError: The task has no such pair.
    """
    start = World(task).initial
    for there in start.actions(player):
        back = _undoing(start, there, player)
        if back is not None:
            return _named(there), _named(back)
    message = f"{player} of {task} cannot move back and forth; choose another --task"
    raise RobotouilleError(message)


def _undoing(start: State, there: GroundAction, player: str) -> GroundAction | None:
    away = start.step(there)
    if away.goal_reached or away.state == start:
        return None
    for back in away.state.actions(player):
        home = away.state.step(back)
        if home.state == start and not home.goal_reached:
            return back
    return None


def _named(action: GroundAction) -> NamedMove:
    return {"name": action.name, "args": list(action.arguments)}
