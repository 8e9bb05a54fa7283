"""Substitutes of absent participants, and the scheduler that decides whose turn it is to plan."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from itertools import count
from typing import TYPE_CHECKING, Protocol

from robotouille.episode import Controller, Episode, Stepped
from robotouille.planning.bot_process import state_row
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.substitutes.bot_worker import BotWorker, BotWorkerLostError
from robotouille_server.rooms.substitutes.bots import BotAnswer, Question
from robotouille_server.runtime.logs import get_logger

if TYPE_CHECKING:
    from robotouille.domain.task import Task
    from robotouille.planning.bot_process import MoveRow

MAX_IN_FLIGHT = 8
"""Questions sent to the worker at once: enough to keep it busy while answers are on their way."""
MAX_OBSERVED = 64
"""Steps kept for a bot until its next question. A bot that misses more starts over."""


class BotClient(Protocol):
    """Bot that waits for its turn to ask the worker."""

    def question(self) -> tuple[Task, Question] | None:
        """Return the bot's question; None if nothing is left to decide."""

    def answered(self, answer: BotAnswer) -> None:
        """Receive the answer, which may be None."""


class BotScheduler:
    """Queue of a server's substitutes for the worker, by deadline.

    The queue contains bots, not questions. A bot makes its question when its turn comes, so no
    question is about a past state. While the queue is empty, the worker prepares seats.
    """

    def __init__(self, make_worker: Callable[[], BotWorker]) -> None:
        self._make_worker = make_worker
        self._worker: BotWorker | None = None
        self._waiting: list[tuple[float, int, BotClient]] = []
        self._order = count()
        self._numbers = count(1)
        self._to_learn: dict[tuple[str, str], Task] = {}
        self._in_flight = 0
        self._closed = False

    def new_bot(self) -> int:
        """Return the number of a new bot."""
        return next(self._numbers)

    def learn(self, task: Task, player: str) -> None:
        """Prepare a seat of a task when the worker is idle."""
        # All rooms share what is learnt, so each seat of a task is prepared once.
        self._to_learn.setdefault((task.digest, player), task)
        self._dispatch()

    def schedule(self, bot: BotClient, deadline: float) -> None:
        """Queue a bot whose answer is due at `deadline`. Late answers may still be useful."""
        heappush(self._waiting, (deadline, next(self._order), bot))
        self._dispatch()

    async def close(self) -> None:
        """Ask no more questions and end the worker."""
        self._closed = True
        self._waiting.clear()
        self._to_learn.clear()
        if self._worker is not None:
            await self._worker.close()

    def _dispatch(self) -> None:
        while self._waiting and self._in_flight < MAX_IN_FLIGHT and not self._closed:
            _, _, bot = heappop(self._waiting)
            asked = bot.question()
            if asked is not None:
                self._watch(self._get_worker().ask(*asked), bot.answered)
        # Preparing takes up to two seconds in a large kitchen, so it must not delay an answer.
        if self._to_learn and not self._in_flight and not self._closed:
            _, player = key = next(iter(self._to_learn))
            learning = self._get_worker().learn(self._to_learn.pop(key), player)
            self._watch(learning, lambda _: None)

    def _get_worker(self) -> BotWorker:
        if self._worker is None:
            self._worker = self._make_worker()
        return self._worker

    def _watch(
        self, future: asyncio.Future[BotAnswer], deliver: Callable[[BotAnswer], None]
    ) -> None:
        self._in_flight += 1
        # A callback is cheaper than a task per question, and hundreds of substitutes may ask in one
        # step.
        future.add_done_callback(partial(self._done, deliver))

    def _done(
        self, deliver: Callable[[BotAnswer], None], future: asyncio.Future[BotAnswer]
    ) -> None:
        self._in_flight -= 1
        if self._closed:
            # Retrieve the exception, or asyncio logs that nobody did.
            _ = future.cancelled() or future.exception()
            return
        try:
            deliver(_result(future))
        finally:
            self._dispatch()


def _result(future: asyncio.Future[BotAnswer]) -> BotAnswer:
    failure = None if future.cancelled() else future.exception()
    if failure is not None and not isinstance(failure, BotWorkerLostError):
        # A bug in a planner costs this bot its turn, not the episode.
        get_logger().error("a substitute failed", exc_info=failure)
    return None if failure is not None or future.cancelled() else future.result()


class SubstituteBot:
    """Bot for one seat.

    It exists from the start of the episode and observes every step, so that it can act in the
    step after its participant disappears. It asks one question at a time.
    """

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
        """Prepare the worker while the participant still plays."""
        if not self._warm and self._episode.rules.substitute != "random":
            self._warm = True
            self._scheduler.learn(self._episode.world.task, self._player)

    def observe(self, event: Stepped) -> None:
        """Keep a step for the next question."""
        # A bot that was never asked has no memory to keep up to date, so nothing is stored for it.
        if self._number:
            self._observed.append(event)
            # A bot that is asked rarely would otherwise keep every step. A new number makes it
            # start over.
            if len(self._observed) > MAX_OBSERVED:
                self._number = 0
                self._observed.clear()

    def consider(self) -> None:
        """Queue a question about the current step if the bot has to decide for its seat."""
        if not self._scheduled and self._must_decide():
            self._scheduled = True
            rules = self._episode.rules
            # Real-time steps have a deadline; other clocks wait for the bot, so it is due at once.
            self._scheduler.schedule(self, self._now() + (rules.period if rules.scheduled else 0.0))

    def stop(self) -> None:
        """Stop, because the episode has ended or was handed over."""
        self._stopped = True

    def _must_decide(self) -> bool:
        episode = self._episode
        seat = episode.seats[self._player]
        return (
            not self._stopped
            and episode.running
            and seat.controller is Controller.SUBSTITUTE
            and seat.pending is None
            and episode.on_turn in (None, self._player)
            and episode.state.busy_steps(self._player) == 0
        )

    def question(self) -> tuple[Task, Question] | None:
        """Return the question about the current state; None if there is nothing to decide."""
        if not self._must_decide():
            self._scheduled = False
            return None
        episode, state = self._episode, self._episode.state
        self._number = self._number or self._scheduler.new_bot()
        self._asked_at = episode.step
        observed = tuple(_move_rows(event) for event in self._observed)
        self._observed.clear()
        return episode.world.task, Question(
            self._number,
            self._player,
            episode.rules.substitute,
            state_row(state),
            observed,
        )

    def answered(self, answer: BotAnswer) -> None:
        """Act, unless nothing is left to decide or the answer is outdated."""
        self._scheduled = False
        if not self._must_decide():
            return
        episode, action = self._episode, None
        if answer is not None:
            action = episode.world.action(answer[0], *answer[1:])
        in_time = episode.step == self._asked_at
        # A late answer is still used if its action is valid now: a busy worker may always be late.
        if in_time or (action is not None and episode.world.applicable(episode.state, action)):
            self._decide(self._player, action)
        else:
            self.consider()


def _move_rows(event: Stepped) -> tuple[MoveRow, ...]:
    return tuple(
        (move.player, move.action.name, move.action.arguments, attempt.applied)
        for move, attempt in zip(event.moves, event.attempts, strict=True)
    )
