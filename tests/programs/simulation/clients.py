"""Players and spectators: the real client library and bots, with every message checked."""

from __future__ import annotations

import asyncio
import random
import traceback
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from robotouille import GroundAction
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK
from robotouille.protocol.participant_names import likeness
from robotouille_client import ActResult, Client, Game
from robotouille_client.bots import RandomPolicy, play
from robotouille_client.errors import ConnectionFailedError
from robotouille_server.rooms.participants.seat_limits import RESERVED_NAMES
from robotouille_server.rooms.publishing.broadcaster import KEPT_SAID
from tests.programs.simulation.loop import Process, current_process

if TYPE_CHECKING:
    from tests.programs.simulation.scenario import Enlisted, EpisodePlan
    from tests.programs.simulation.simulation import Simulation

__all__ = ["Participant", "WatchedClient"]

PORT = 8765
COME_AGAIN = {
    "seat/taken",
    "episode/full",
    "rate/limited",
    "server/recording",
    "server/handover",
    "server/draining",
}
NO_MORE = {"episode/ended"}


class WatchedClient(Client):
    """The unchanged client; each message and reply is compared with the recordings."""

    def __init__(self, participant: Participant, incarnation: str, **options: Any) -> None:
        super().__init__(**options)
        self.participant = participant
        self.incarnation = incarnation
        self.sim = participant.sim
        self.came_back = False
        self._chat: int | None = None
        self._watched: Game | None = None
        self._last = -1

    def _receive(self, message: messages.ServerMessage, size: int) -> None:
        self.sim.trace("receives", self.incarnation, message)
        heard = self.game.said if self.game is not None else 0
        super()._receive(message, size)
        game = self.game
        if game is None:
            return
        if game is not self._watched:
            self._watch(game)
        if isinstance(message, messages.Joined) and message.ref is not None:
            self._chat = None
        if isinstance(message, messages.Said):
            self._check_said(game, message, heard)
        elif isinstance(message, messages.Roster | messages.Snapshot):
            self._check_company(message.seats)
        elif isinstance(message, messages.Ended):
            self._check_outcome(game, message)
        self._check_state(game, message)

    def come_back_with(self, resume: str) -> None:
        """Start with the resume token of another machine."""
        plan, participant = self.participant.plan, self.participant
        self.came_back, self.protocol.resume = True, resume
        if plan.code is not None:
            self.protocol.membership = messages.Join(
                episode=plan.code,
                role=participant.role,
                view=participant.view,
                seats=participant.wanted,
            )

    def _watch(self, game: Game) -> None:
        """Watch a new game, including its actions and their results."""
        self._watched, self._last, self._chat = game, -1, None
        self.participant.plan.entered(self.incarnation, game.episode)
        submit = game.submit

        def watched(
            action: Any, seat: str | None = None, **options: Any
        ) -> asyncio.Future[ActResult]:
            future = submit(action, seat, **options)
            answered = partial(self._act_answered, game, seat or game.seat, game._sent.seq, action)
            future.add_done_callback(answered)
            return future

        game.submit = watched  # type: ignore[method-assign]

    def _act_answered(
        self, game: Game, seat: str, seq: int, action: Any, done: asyncio.Future[ActResult]
    ) -> None:
        if done.cancelled() or not done.result().applied:
            return
        step = done.result().step
        self.sim.oracle.check_applied(
            self.incarnation, game, seat, seq, step, action, exactly=game.has_state
        )

    def _check_state(self, game: Game, message: messages.ServerMessage) -> None:
        if not game.has_state:
            return
        if game.step < self._last:
            self.sim.fail(f"{self.incarnation}: went back from step {self._last} to {game.step}")
        if game.step != self._last or isinstance(message, messages.Snapshot):
            self._last = game.step
            self.sim.oracle.check_state(
                self.incarnation, game.episode, game.step, game.state.digest
            )

    def _check_said(self, game: Game, message: messages.Said, heard: int) -> None:
        """Check that a chat message is recorded and that none is missing, except for newcomers."""
        self.sim.oracle.check_said(self.incarnation, game.episode, message.text)
        if not self.participant.plan.owns(message.text):
            self.sim.fail(f"{self.incarnation}: received {message.text!r} of another episode")
        if message.number <= heard:
            return
        before, self._chat = self._chat, message.number
        lossy = self.incarnation in self.sim.adversary.mangled
        if before is None or message.number == before + 1 or lossy:
            return
        if self.sim.oracle.said_since(game.episode, before) <= KEPT_SAID:
            self.sim.fail(f"{self.incarnation}: chat message {message.number} followed {before}")

    def _check_company(self, seats: list[messages.SeatInfo]) -> None:
        names = Counter(likeness(seat.name) for seat in seats if seat.name)
        if any(count > self.participant.plan.seats_of(name) for name, count in names.items()):
            self.sim.fail(f"{self.incarnation}: two participants have the same name: {names}")
        posing = RESERVED_NAMES | {likeness(seat.player) for seat in seats}
        if any(likeness(seat.name) in posing - {likeness(seat.player)} for seat in seats):
            self.sim.fail(f"{self.incarnation}: a participant poses as another: {names}")
        strangers = [s.name for s in seats if s.name and not self.participant.plan.knows(s.name)]
        if strangers:
            self.sim.fail(f"{self.incarnation}: sees {strangers} of another episode")

    def _check_outcome(self, game: Game, message: messages.Ended) -> None:
        truth = self.sim.oracle.find(game.episode)
        if truth is None or truth.outcome != message.outcome:
            self.sim.fail(f"{self.incarnation}: unrecorded outcome {message.outcome}")


class Participant:
    """Participant of one episode, across reconnects, crashes and new machines."""

    def __init__(self, sim: Simulation, plan: EpisodePlan, enlisted: Enlisted) -> None:
        self.sim = sim
        self.plan = plan
        self.name = enlisted.name
        self.role = enlisted.role
        self.creates = enlisted.creates
        self.view = enlisted.view
        self.encoding = enlisted.encoding
        self.talks = enlisted.talks
        self.seats = enlisted.seats
        self.client: WatchedClient | None = None
        self.process: Process | None = None
        self.done = False
        self.lives = 0
        self.said = 0
        self._processes: list[Process] = []
        self._trying: list[Process] = []
        self._chance = random.Random(f"{sim.seed}/{self.name}")

    def start(self, resume: str | None = None) -> None:
        """Start, or continue in a new process, with the old resume token if given."""
        self.lives += 1
        incarnation = f"{self.name}.{self.lives}"
        process = self.process = Process(incarnation, self.sim.loop)
        self.sim.processes.append(process)
        self._processes.append(process)
        self._trying.append(process)
        process.on_death.append(lambda: self.sim.network.close_all(process))
        living = process.start(self._live(process, incarnation, resume))
        living.add_done_callback(partial(self._ended, process))

    def _ended(self, process: Process, task: asyncio.Task[None]) -> None:
        """Report errors of the library that a bot's code does not expect."""
        self._trying.remove(process)
        if not task.cancelled() and (error := task.exception()) is not None:
            trace = "".join(traceback.format_exception(error, limit=-3))
            self.sim.fail(f"{self.name}: the client library raised {trace}")

    def gone(self) -> None:
        """Switch off all machines."""
        for process in self._processes:
            process.kill()

    @property
    def token(self) -> str | None:
        """Return the resume token of the present connection."""
        return self.client.resume if self.client is not None else None

    async def _live(self, mine: Process, incarnation: str, resume: str | None) -> None:
        tries = 0
        while not self.done:
            tries += 1
            client = self.client = WatchedClient(
                self,
                incarnation,
                url=f"ws://127.0.0.1:{PORT}",
                name=self.name,
                codec=JSON if self.encoding == "json" else MSGPACK,
                rng=random.Random(f"{self.sim.seed}/{incarnation}"),
            )
            if resume is not None:
                client.come_back_with(resume)
                resume = None
            try:
                async with client:
                    over = await self._take_part(client)
            except ConnectionFailedError as error:
                self.sim.trace("fails", incarnation, str(error))
                over = self.plan.over
            except ProtocolError as error:
                self.sim.trace("refused", incarnation, error.code)
                over = self._refused(error)
            if over or self.plan.over:
                self.done = True
            elif "elsewhere" in client.farewell and self._others_try(mine):
                self.process = None if self.process is mine else self.process
                return
            elif self.process is not mine and self._others_try(mine):
                return
            else:
                self.process = mine
                await asyncio.sleep(min(5.0, tries * self._chance.uniform(0.2, 1.0)))

    def _others_try(self, mine: Process) -> bool:
        """Return whether another machine of the participant continues; at least one must."""
        return any(process is not mine for process in self.tries)

    @property
    def tries(self) -> list[Process]:
        """Return the running machines that try to take part, newest last."""
        return [process for process in self._trying if not process.dead]

    async def _take_part(self, client: WatchedClient) -> bool:
        """Create or join an episode and play; return whether the episode has ended."""
        game = await self._enter(client)
        chat = asyncio.create_task(self._chat(client, game)) if self.talks else None
        try:
            if self.role == "spectator":
                async for _ in game:
                    pass
            elif len(game.own_seats) > 1:
                await self._play_several(game)
            elif self.view == "text":
                await self._play_by_text(game)
            else:
                await play(game, self._make_policy, threaded=False)
        finally:
            if chat is not None:
                chat.cancel()
        return game.finished

    async def _enter(self, client: WatchedClient) -> Game:
        if client.came_back and (game := await self._game_again(client)) is not None:
            return game
        while self.plan.code is None:
            if self.creates and self.tries and current_process() is self.tries[-1]:
                created = await client.create(self.plan.task, **self.plan.options)
                self.plan.code = self.plan.code or created.code
            else:
                await asyncio.sleep(0.1)
        return await client.join(self.plan.code, role=self.role, view=self.view, seats=self.wanted)

    @property
    def wanted(self) -> Literal["all"] | list[str]:
        """Return the seats to request; an empty list requests any free seat."""
        return "all" if self.seats == "all" else list(self.seats)

    async def _game_again(self, client: WatchedClient) -> Game | None:
        """Wait for the game of a resumed session, which arrives by itself if it still exists."""
        for _ in range(50):
            game = client.game
            if game is not None and (game.has_state or game.observation is not None):
                return game
            await asyncio.sleep(0.1)
        return None

    def _refused(self, error: ProtocolError) -> bool:
        """Interpret a refusal: return True if the episode has ended, False to try again later.

        Any other refusal is a fault of the server.
        """
        if error.code in NO_MORE:
            return True
        if error.code == "episode/unknown":
            return self.plan.vanished()
        if error.code not in COME_AGAIN:
            self.sim.suspect(f"{self.name} was refused: {error.code}: {error}")
        return False

    def _make_policy(self, state: Any, player: str) -> RandomPolicy:
        return RandomPolicy(player, self.sim.seed)

    async def _play_by_text(self, game: Game) -> None:
        decided = -1
        while not game.ended:
            seen = game.observation
            if game.running and seen is not None and seen.step > decided and game.my_move:
                decided = seen.step
                action = self._chance.choice(seen.actions) if seen.actions else None
                await game.act(action)
            elif not game.ended:
                await game.next_event()

    async def _play_several(self, game: Game) -> None:
        """Play all seats at the same time; choose again after a rejection."""
        decided = dict.fromkeys(game.own_seats, -1)

        def answered(seat: str, done: asyncio.Future[ActResult]) -> None:
            if not done.cancelled() and not done.result().applied:
                decided[seat] = -1

        while not game.ended:
            for seat in game.own_seats:
                actions = self._actions_of(game, seat)
                if actions is None or not game.may_act(seat) or game.step <= decided[seat]:
                    continue
                decided[seat] = game.step
                action = self._chance.choice(actions) if actions else None
                game.submit(action, seat=seat).add_done_callback(partial(answered, seat))
            await game.next_event()

    def _actions_of(self, game: Game, seat: str) -> Sequence[GroundAction | str] | None:
        """Return a seat's valid actions in the present step, or None if they are unknown."""
        if game.has_state:
            return game.state.actions(seat)
        seen = game.observations.get(seat)
        return seen.actions if seen is not None and seen.step == game.step else None

    async def _chat(self, client: WatchedClient, game: Game) -> None:
        while True:
            await asyncio.sleep(self._chance.expovariate(self.talks))
            self.said += 1
            game.say(f"{self.plan.tag}/{self.name}/{self.said}")
