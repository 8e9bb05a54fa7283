"""Clocks: rules for when a step is due, who may act, and whose decision a step waits for.

A clock does not hold the episode. It yields the times of steps to take now; the episode takes each
step before the clock goes on, so the clock sees its effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import ceil
from typing import Protocol

from robotouille.episode.rules import Clock, Rules

MAX_CATCH_UP = 10
"""Late steps that a real-time episode takes. The rest is skipped: a server that was suspended for a
minute must not play that minute in one burst."""
MAX_LATE_AT_ONCE = 2
"""Late steps that a real-time episode takes for one tick. With limited sight, ten steps of four
players delayed the steps of all other episodes by 200 ms."""
MAX_STEPS_AT_ONCE = 10
"""Steps taken for one request. Long runs of steps in which nobody can act would otherwise keep
other episodes from their turn; the rest follows at the next ticks. A declared thinking time may
ask for thousands of steps."""


class ClockedEpisode(Protocol):
    """The part of an episode that a clock reads."""

    step: int

    @property
    def running(self) -> bool:
        """True from the start to the end, except during pauses."""
        ...

    def all_decided(self, players: Iterable[str]) -> bool:
        """Return whether a step need not wait for any of these players."""
        ...


# Clocks do not know the reasons for pauses. They only ask whether the episode is `running`, so
# every reason works with every clock (docs/decisions/0015).
class StepClock(Protocol):
    """Rule for when the next step is taken. `scheduled`: steps follow the wall clock."""

    scheduled: bool

    @property
    def behind(self) -> bool:
        """True if the last request or tick left due steps for the next tick."""
        ...

    def start(self, now: float) -> None:
        """Start with the game, or when another process goes on with it."""

    def resume(self, now: float) -> None:
        """Resume after a pause."""

    def start_move(self, now: float) -> None:
        """Restart the move budget."""

    def due(self) -> float | None:
        """Return when `on_tick` has something to do if nobody decides before."""

    def on_turn(self, step: int) -> str | None:
        """Return the only player who may act in the step after `step`; None if all may."""

    def awaited(self, step: int) -> Sequence[str]:
        """Return the players whose decisions the step after `step` waits for."""

    def delay(self, think_ms: int) -> int:
        """Return the number of steps by which declared thinking time delays an action."""

    def on_decision(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        """Yield the times of the steps to take after a decision, or after a seat's absence."""

    def on_tick(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        """Yield the times of the steps to take because time has passed."""


class LockstepClock:
    """Clock whose steps wait for everybody's decision, at most for the move budget."""

    scheduled = False

    def __init__(self, rules: Rules, players: Sequence[str]) -> None:
        self._players = tuple(players)
        self._budget = rules.move_budget
        self._deadline: float | None = None
        # If a request has used up `MAX_STEPS_AT_ONCE`, this is the time at which the other steps
        # became due. The next tick continues from there without waiting for the deadline.
        self._backlog: float | None = None

    @property
    def behind(self) -> bool:
        return self._backlog is not None

    def start(self, now: float) -> None:
        pass

    def resume(self, now: float) -> None:
        pass

    def start_move(self, now: float) -> None:
        # Every step has the whole budget. A budget for the episode would punish a seat for the slow
        # decisions of the others.
        self._deadline = now + self._budget if self._budget else None

    def due(self) -> float | None:
        return self._deadline if self._backlog is None else self._backlog

    def on_turn(self, step: int) -> str | None:
        return None

    def awaited(self, step: int) -> Sequence[str]:
        return self._players

    def delay(self, think_ms: int) -> int:
        return 0

    def on_decision(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        self._backlog = None
        for _ in range(MAX_STEPS_AT_ONCE):
            if not game.running or not game.all_decided(self.awaited(game.step)):
                return
            yield now
        self._backlog = now

    def on_tick(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        if self._backlog is None:
            # The budget is over, so one step is taken with the decisions that exist. The seats that
            # did not decide do nothing in it.
            if self._deadline is None or now < self._deadline:
                return
            yield now
        yield from self.on_decision(now, game)


# The turn follows from the number of the step alone, so a recording need not store it, and
# `robotouille.replay.measures` computes it again in the same way.
class TurnClock(LockstepClock):
    """Clock with which players act one after the other. A step waits for the player on turn."""

    def on_turn(self, step: int) -> str | None:
        return self._players[step % len(self._players)]

    def awaited(self, step: int) -> Sequence[str]:
        return (self._players[step % len(self._players)],)


class DeclaredClock(LockstepClock):
    """Real time in which seats declare how long they thought.

    Steps wait for everybody, and an action takes effect as many steps later as the declared time
    is long. A run is therefore repeatable, however fast the machine is.
    """

    def __init__(self, rules: Rules, players: Sequence[str]) -> None:
        super().__init__(rules, players)
        self._step_rate = rules.step_rate

    def delay(self, think_ms: int) -> int:
        # The result is rounded up, because in real time an action that arrives during a step's
        # period also waits for the end of that period.
        return ceil(think_ms / 1000 * self._step_rate)


class RealTimeClock:
    """Clock with one step in each period. A step takes the decisions made until then."""

    scheduled = True

    def __init__(self, rules: Rules) -> None:
        # The period never changes, because the header of the recording contains the rules.
        self._period = rules.period
        self._next_step = 0.0
        self._caught_up = 0
        self.behind = False

    def start(self, now: float) -> None:
        self._next_step = now + self._period

    def resume(self, now: float) -> None:
        # Give players a whole period to look at the kitchen before its first step.
        self._skip_to(now + self._period)

    def start_move(self, now: float) -> None:
        pass

    def due(self) -> float | None:
        return self._next_step

    def on_turn(self, step: int) -> str | None:
        return None

    def awaited(self, step: int) -> Sequence[str]:
        return ()

    def delay(self, think_ms: int) -> int:
        return 0

    def on_decision(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        return ()

    def on_tick(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        for _ in range(MAX_LATE_AT_ONCE):
            if not game.running or now < self._next_step:
                break
            # The scheduled time and not `now`: held requests and recorded times are then the same
            # if the server's tick came late.
            yield self._next_step
            self._next_step += self._period
            self._caught_up += 1
        self.behind = now >= self._next_step
        if not self.behind:
            self._caught_up = 0
        elif self._caught_up >= MAX_CATCH_UP:
            self._skip_to(now + self._period)

    def _skip_to(self, at: float) -> None:
        self._next_step = max(self._next_step, at)
        self._caught_up, self.behind = 0, False


def clock_for(rules: Rules, players: Sequence[str]) -> StepClock:
    """Return the clock that the rules ask for."""
    match rules.clock:
        case Clock.TURN:
            return TurnClock(rules, players)
        case Clock.LOCKSTEP:
            return LockstepClock(rules, players)
        case Clock.REALTIME if rules.thinking == "declared":
            return DeclaredClock(rules, players)
        case Clock.REALTIME:
            return RealTimeClock(rules)
