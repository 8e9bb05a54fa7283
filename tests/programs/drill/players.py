"""A process with many bots that plays one episode after another in each slot until told to stop.

It writes its events to standard output, one JSON object per line. On standard input, `finish` stops
new episodes, `report` requests the situations of the players that are still active, and `mark`
requests each player's next applied action.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

from robotouille.errors import RobotouilleError
from robotouille.planning.policies.policy import Policy
from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State
from robotouille_client import ActResult, Client, Game
from robotouille_client.bots import play
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.seat_policy import MakePolicy
from robotouille_client.errors import ConnectionFailedError
from tests.programs.drill.games import MIXES, GameSpec, draw_game, mix_of, plan_of
from tests.programs.drill.witness import Witness
from tests.support.lost_connections import cut

Answer = TypeVar("Answer")

LOOK_SECONDS = 0.02
BREAK_SECONDS = 7.0
"""Seconds between two breaks of a flaky connection."""
LATE_SECONDS = 0.5
"""Seconds after which a step of a real-time episode is reported as late."""
TEMPORARY = ("server/draining", "server/handover", "server/recording")
"""Answers to requests that may succeed later."""


class Deliberate:
    """Policy with a fixed thinking time, which runs in a thread."""

    def __init__(self, policy: Policy, seconds: float) -> None:
        self._policy = policy
        self._seconds = seconds

    def observe(self, did: Any) -> None:
        self._policy.observe(did)

    def act(self, state: State) -> GroundAction | None:
        time.sleep(self._seconds)
        return self._policy.act(state)


def tell(event: str, **facts: Any) -> None:
    """Report an event to the drill."""
    print(json.dumps({"event": event, "at": time.monotonic(), **facts}), flush=True)


@asynccontextmanager
async def reachable(url: str, name: str) -> AsyncIterator[Client]:
    """Connect as soon as there is a server."""
    while True:
        client = Client(url, name=name)
        try:
            await client.__aenter__()
            break
        except ConnectionFailedError:
            await asyncio.sleep(0.2)
    try:
        yield client
    finally:
        await client.close()


class Participant:
    """One bot in one seat, from its first connection to the end of its episode."""

    def __init__(self, url: str, name: str, spec: GameSpec, number: int, folder: Path) -> None:
        self.name = name
        self.client: Client | None = None
        self.game: Game | None = None
        self._url = url
        self._spec = spec
        self._number = number
        self._folder = folder
        self._here = False
        self._marked: float | None = None
        self._step, self._step_at = -1, 0.0

    async def open(self) -> str:
        """Create the episode and return its code."""
        async with reachable(self._url, self.name) as client:
            spec = self._spec
            return (await retried(lambda: client.create(spec.task, **spec.options))).code

    async def play(self, code: str, seat: str | None = None) -> None:
        """Take a seat and play to the end."""
        async with reachable(self._url, self.name) as client:
            self.client = client
            self.game = game = await self._join(client, code, seat)
            witness = Witness(game, self.name, self._folder, self._heard)
            self._report_actions(game)
            tell("joined", who=self.name, episode=game.episode)
            tasks = [asyncio.create_task(self._watch_connection(client))]
            if self._spec.flaky[self._number]:
                tasks.append(asyncio.create_task(self._break_connection(client)))
            self._is_back()
            try:
                await play(game, self._policy)
                await witness.close()
            finally:
                for task in tasks:
                    task.cancel()
            tell("over", who=self.name, episode=game.episode, outcome=game.outcome or {})

    def _policy(self, state: State, player: str) -> Policy:
        kind = BotKind(self._spec.bots[self._number])
        make: MakePolicy = policy_maker(kind, self._spec.seed, plan_of(self._spec))
        return Deliberate(make(state, player), self._spec.think)

    async def _join(self, client: Client, code: str, seat: str | None) -> Game:
        return await retried(lambda: client.join(code, seat=seat))

    def _heard(self, message: messages.ServerMessage) -> None:
        self._is_back()
        if isinstance(message, messages.Delta | messages.Snapshot):
            self._stepped(message.step, time.monotonic())

    def _is_back(self) -> None:
        if not self._here:
            self._here = True
            tell("back", who=self.name)

    def _stepped(self, step: int, now: float) -> None:
        """Report a step that comes late, unless the episode has no clock."""
        if step <= self._step or self._spec.clock != "realtime":
            return
        late = now - self._step_at - 1 / self._spec.step_rate
        if self._step >= 0 and late > LATE_SECONDS:
            tell("late", who=self.name, seconds=late, step=step)
        self._step, self._step_at = step, now

    def mark(self) -> None:
        """Report the next applied action among those that are submitted from now on."""
        self._marked = time.monotonic()

    def _report_actions(self, game: Game) -> None:
        """Report the first applied action that was submitted after a mark."""
        submit = game.submit

        def submitted(*given: Any, **details: Any) -> asyncio.Future[ActResult]:
            begun, future = time.monotonic(), submit(*given, **details)
            future.add_done_callback(lambda done: self._answered(begun, done))
            return future

        game.submit = submitted  # type: ignore[method-assign]

    def _answered(self, begun: float, done: asyncio.Future[ActResult]) -> None:
        marked = self._marked
        if marked is None or begun < marked or done.cancelled() or done.exception():
            return
        if done.result().applied:
            self._marked = None
            tell("acted", who=self.name, marked=marked)

    async def _watch_connection(self, client: Client) -> None:
        while True:
            await client.connected.wait()
            while client.connected.is_set():
                await asyncio.sleep(LOOK_SECONDS)
            self._here = False
            tell("lost", who=self.name)

    async def _break_connection(self, client: Client) -> None:
        while True:
            await asyncio.sleep(BREAK_SECONDS)
            if client.connected.is_set():
                cut(client)

    @property
    def situation(self) -> dict[str, Any]:
        """Return the bot's status, for the diagnosis of an episode that does not end."""
        game, client = self.game, self.client
        return {
            "who": self.name,
            "task": self._spec.task,
            "clock": self._spec.clock,
            "absence": self._spec.absence,
            "bot": self._spec.bots[self._number],
            "connected": client is not None and client.connected.is_set(),
            "episode": game.episode if game else "",
            "step": game.step if game else -1,
            "limit": self._spec.max_steps,
            "phase": game.phase if game else "",
            "pause": game.pause.model_dump() if game and game.pause else None,
            "turn": game.turn if game else None,
            "seats": [seat.model_dump() for seat in game.seats] if game else [],
            "unanswered": [act.model_dump() for act in game.unanswered] if game else [],
        }


class Stopping(asyncio.Event):
    """Event that is set when no more episodes should start."""

    async def obey(
        self, situations: Callable[[], list[dict[str, Any]]], mark: Callable[[], None]
    ) -> None:
        """Process standard input: `report` prints all situations, `mark` calls `mark`, any other
        line stops.
        """
        reader = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        while line := await reader.readline():
            if line.strip() == b"report":
                for situation in situations():
                    tell("situation", **situation)
                tell("reported")
            elif line.strip() == b"mark":
                mark()
            else:
                self.set()


class Slots:
    """All slots of this process."""

    def __init__(self, given: argparse.Namespace) -> None:
        self._given = given
        self._folder = Path(given.folder)
        self._stopping = Stopping()
        self._playing: dict[str, Participant] = {}

    async def run(self) -> None:
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(128))
        obeying = asyncio.create_task(self._stopping.obey(self._situations, self._mark))
        await asyncio.gather(*(self._slot(slot) for slot in self._given.slots))
        obeying.cancel()
        tell("finished")

    def _situations(self) -> list[dict[str, Any]]:
        return [participant.situation for participant in self._playing.values()]

    def _mark(self) -> None:
        for participant in self._playing.values():
            participant.mark()

    async def _slot(self, slot: int) -> None:
        given, number = self._given, 0
        await asyncio.sleep(slot * 0.02)
        while not self._stopping.is_set():
            steps = (given.min_steps, given.max_steps)
            mix = mix_of(given.mix, given.rate)
            spec = draw_game(given.seed, slot, number, steps=steps, mix=mix)
            await self._game(spec, f"s{slot}g{number}")
            number += 1

    async def _game(self, spec: GameSpec, name: str) -> None:
        players = [
            Participant(self._given.url, f"{name}p{i}", spec, i, self._folder)
            for i in range(spec.seats)
        ]
        try:
            code = await players[0].open()
            tell("opened", who=name, seats=spec.seats)
            async with asyncio.TaskGroup() as group:
                for player in players:
                    self._playing[player.name] = player
                    group.create_task(player.play(code))
        except* RobotouilleError as failures:
            for failure in failures.exceptions:
                tell("failed", who=name, error=f"{type(failure).__name__}: {failure}")
        finally:
            for player in players:
                self._playing.pop(player.name, None)


async def retried(request: Callable[[], Awaitable[Answer]]) -> Answer:
    """Return the answer to a request, which is repeated while its failure is temporary."""
    while True:
        try:
            return await request()
        except RobotouilleError as error:
            code = getattr(error, "code", "")
            if not isinstance(error, ConnectionFailedError) and code not in TEMPORARY:
                raise
            await asyncio.sleep(0.2)


def options() -> argparse.Namespace:
    """Return the command-line options of a drill process."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--url", required=True)
    parser.add_argument("--folder", required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--min-steps", type=int, required=True)
    parser.add_argument("--max-steps", type=int, required=True)
    parser.add_argument("--mix", choices=MIXES, default="all")
    parser.add_argument("--rate", type=float, default=0.0)
    parser.add_argument("slots", type=int, nargs="+")
    return parser.parse_args()


def main() -> None:
    asyncio.run(Slots(options()).run())


if __name__ == "__main__":
    main()
