"""Bots that play the seats of absent participants."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING

from robotouille.episode import Controller, Episode, Stepped
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.substitutes.bot_scheduler import BotScheduler
from robotouille_server.rooms.substitutes.bots import BotAnswer, ObservedMove, Question

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = ["SubstituteBot"]

MAX_OBSERVED = 64
"""Steps that are kept for a bot until it is asked; one that has missed more begins anew."""


class SubstituteBot:
    """A bot for one seat. It is made when the game begins and told every step, so that it can act
    in the very next one; it asks one question at a time."""

    __slots__ = (
        "_asked_at",
        "_decide",
        "_episode",
        "_now",
        "_number",
        "_observed",
        "_player",
        "_scheduled",
        "_scheduler",
        "_stopped",
        "_warm",
    )

    def __init__(
        self,
        episode: Episode,
        player: str,
        scheduler: BotScheduler,
        decide: Callable[[str, GroundAction | None], None],
    ) -> None:
        self._episode = episode
        self._player = player
        self._scheduler = scheduler
        self._decide = decide
        self._now = asyncio.get_running_loop().time
        self._observed: list[Stepped] = []
        self._number = 0
        self._asked_at = 0
        self._warm = self._scheduled = self._stopped = False

    def warm(self) -> None:
        """Get ready while the participant still plays."""
        if not self._warm and self._episode.rules.stand_in != "random":
            self._warm = True
            self._scheduler.learn(self._episode.world.task, self._player)

    def observe(self, event: Stepped) -> None:
        """What everybody did in a step."""
        if self._number:
            self._observed.append(event)
            if len(self._observed) > MAX_OBSERVED:
                self._begin_anew()

    def _begin_anew(self) -> None:
        self._number = 0
        self._observed.clear()

    def consider(self) -> None:
        """Decide about the present step, if the seat is the bot's and has to decide."""
        if not self._scheduled and self._must_decide():
            self._scheduled = True
            rules = self._episode.rules
            self._scheduler.schedule(self, self._now() + (rules.period if rules.scheduled else 0.0))

    def stop(self) -> None:
        """The episode is over or goes on elsewhere."""
        self._stopped = True

    def _must_decide(self) -> bool:
        episode = self._episode
        seat = episode.seats[self._player]
        return (
            not self._stopped
            and episode.running
            and seat.controller is Controller.STAND_IN
            and seat.pending is None
            and episode.on_turn in (None, self._player)
            and episode.state.busy_steps(self._player) == 0
        )

    def question(self) -> tuple[Task, Question] | None:
        """What to do in the present state, now that it is this one's turn to ask."""
        if not self._must_decide():
            self._scheduled = False
            return None
        episode, state = self._episode, self._episode.state
        self._number = self._number or self._scheduler.new_bot()
        self._asked_at = episode.step
        observed = tuple(_observed_moves(event) for event in self._observed)
        self._observed.clear()
        return episode.world.task, Question(
            self._number,
            self._player,
            episode.rules.stand_in,
            state.facts,
            state.timer_rows(),
            state.timers.busy,
            observed,
        )

    def answered(self, answer: BotAnswer) -> None:
        """Act, unless there is nothing to decide any more or the answer came too late."""
        self._scheduled = False
        if not self._must_decide():
            return
        episode, action = self._episode, None
        if answer is not None:
            action = episode.world.action(answer[0], *answer[1:])
        in_time = episode.step == self._asked_at
        if in_time or (action is not None and episode.world.applicable(episode.state, action)):
            self._decide(self._player, action)
        else:
            self.consider()


def _observed_moves(event: Stepped) -> tuple[ObservedMove, ...]:
    return tuple(
        (move.player, move.action.name, move.action.arguments, attempt.applied)
        for move, attempt in zip(event.moves, event.attempts, strict=True)
    )
