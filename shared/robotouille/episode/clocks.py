"""The clocks of an episode: when a step is due, who may act, and whose decision it waits for.

A clock holds no episode. It is told the time and looks at the `ClockedEpisode`, and says at which
times steps are to be taken now. What it does not know is what a step does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import ceil
from typing import Protocol

from robotouille.episode.rules import Clock, Rules

__all__ = [
    "MAX_CATCH_UP",
    "MAX_STEPS_AT_ONCE",
    "ClockedEpisode",
    "DeclaredClock",
    "LockstepClock",
    "RealTimeClock",
    "StepClock",
    "TurnClock",
    "clock_for",
]

MAX_CATCH_UP = 10
"""Steps that a late real-time episode takes at once; the others are left out."""
MAX_STEPS_AT_ONCE = 50
"""Steps taken for one message; what is left is taken when time is told next."""


class ClockedEpisode(Protocol):
    """What a clock sees of an episode."""

    step: int

    @property
    def running(self) -> bool:
        """Whether the game has begun, has not ended, and time runs."""
        ...

    def all_decided(self, players: Iterable[str]) -> bool:
        """Whether nothing more is to be waited for from these."""
        ...


class StepClock(Protocol):
    """When the next step is taken; times are in seconds, on the clock that the episode is told.

    `scheduled` says whether steps follow the wall clock, whoever has acted.
    """

    scheduled: bool

    def start(self, now: float) -> None:
        """The game begins, or goes on in another process."""

    def resume(self, now: float) -> None:
        """The game has stood still until now."""

    def start_move(self, now: float) -> None:
        """Everybody who has to decide has its budget from now on."""

    def due(self) -> float | None:
        """When `on_tick` has something to do, if nobody decides before."""

    def on_turn(self, step: int) -> str | None:
        """The only player who may act in the step after this one; None: all may."""

    def awaited(self, step: int) -> Sequence[str]:
        """The players whose decisions the step after this one waits for."""

    def delay(self, think_ms: int) -> int:
        """The steps after which an action takes effect that took so long to think of."""

    def on_decision(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        """Somebody has decided, or need not any more: the times of the steps to take. They are
        taken one by one, while this goes on."""

    def on_tick(self, now: float, game: ClockedEpisode) -> Iterable[float]:
        """Time has passed: the times of the steps to take, likewise."""


class LockstepClock:
    """A step waits for everybody's decision, for as long as the move budget lasts."""

    scheduled = False

    def __init__(self, rules: Rules, players: Sequence[str]) -> None:
        self._players = tuple(players)
        self._budget = rules.move_budget
        self._deadline: float | None = None
        self._backlog: float | None = None

    def start(self, now: float) -> None:
        pass

    def resume(self, now: float) -> None:
        pass

    def start_move(self, now: float) -> None:
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
            if self._deadline is None or now < self._deadline:
                return
            yield now
        yield from self.on_decision(now, game)


class TurnClock(LockstepClock):
    """The players act one after the other; a step waits for the one whose turn it is."""

    def on_turn(self, step: int) -> str | None:
        return self._players[step % len(self._players)]

    def awaited(self, step: int) -> Sequence[str]:
        return (self._players[step % len(self._players)],)


class DeclaredClock(LockstepClock):
    """Real time in which thinking costs what is declared: steps wait for everybody, and an action
    takes effect as many steps later as would have passed meanwhile."""

    def __init__(self, rules: Rules, players: Sequence[str]) -> None:
        super().__init__(rules, players)
        self._step_rate = rules.step_rate

    def delay(self, think_ms: int) -> int:
        return ceil(think_ms / 1000 * self._step_rate)


class RealTimeClock:
    """A step each period, whoever has acted: what was decided until then is done in it."""

    scheduled = True

    def __init__(self, rules: Rules) -> None:
        self._period = rules.period
        self._next_step = 0.0

    def start(self, now: float) -> None:
        self._next_step = now + self._period

    def resume(self, now: float) -> None:
        self._next_step = max(self._next_step, now + self._period)

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
        taken = 0
        while game.running and now >= self._next_step:
            yield self._next_step
            self._next_step += self._period
            taken += 1
            if taken >= MAX_CATCH_UP:
                self._next_step = max(self._next_step, now + self._period)


def clock_for(rules: Rules, players: Sequence[str]) -> StepClock:
    """The clock of some rules."""
    match rules.clock:
        case Clock.TURN:
            return TurnClock(rules, players)
        case Clock.LOCKSTEP:
            return LockstepClock(rules, players)
        case Clock.REALTIME if rules.thinking == "declared":
            return DeclaredClock(rules, players)
        case Clock.REALTIME:
            return RealTimeClock(rules)
