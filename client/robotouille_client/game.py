"""An episode as one participant sees it: a copy of the state, kept up to date by messages.

`Game` does no I/O: it takes the server's messages and hands out what to send.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Any

from robotouille.domain.task import Task
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.states import StateReader
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.world import World, shared_world
from robotouille_client.events import (
    ActResult,
    Announced,
    Changed,
    GameEvent,
    Heard,
    Observed,
    Over,
    Refused,
    RosterChanged,
)

__all__ = ["Game", "Wish"]

MAX_EVENTS = 10_000
SLOW_DOWN_SECONDS = 0.25
"""After which an action that came too soon after many others is sent again."""

Wish = GroundAction | messages.NamedAction | str | int | None
"""What one can ask to do: a ground action, a named one, its sentence, its place in the list of
valid actions, or None for nothing."""


class Game:
    """One episode: its state, its events, and what one does in it.

    `name` is what one is called in it: with a number where somebody else has the name that one
    asked for. `waits_for` are the seats that a step has waited for, for two seconds at least.
    """

    def __init__(self, send: Callable[[messages.Message], None], joined: messages.Joined) -> None:
        self.episode = joined.episode
        self.code = joined.code
        self.role = joined.role
        self.name = joined.name
        self.seat = joined.seat
        self.step = 0
        self.phase = "waiting"
        self.turn: str | None = None
        self.seats: tuple[messages.SeatInfo, ...] = ()
        self.clock: Mapping[str, Any] = {}
        self.outcome: Mapping[str, Any] | None = None
        self.observation: Observed | None = None
        self.step_time = 0.0
        self.left: float | None = None
        self.pause: messages.Pause | None = None
        self.waits_for: tuple[str, ...] = ()
        self.said = joined.said
        self._send = send
        self._reader: StateReader | None = None
        self._seq = joined.seq
        self._waiting: dict[int, asyncio.Future[ActResult]] = {}
        self._unanswered: dict[int, messages.Act] = {}
        self._sent_at = 0.0
        self._catch_up: int | None = None
        self._events: deque[GameEvent] = deque(maxlen=MAX_EVENTS)
        self._news = asyncio.Event()
        self._resyncing = False
        self._resync_asked = 0
        self.ended = False
        self.farewell = ""

    # State

    @property
    def state(self) -> State:
        """The current state; RuntimeError before the first snapshot or in a text view."""
        if self._reader is None:
            raise RuntimeError("no state yet: the view is 'text', or the snapshot is on its way")
        return self._reader.state

    @property
    def has_state(self) -> bool:
        return self._reader is not None

    @property
    def world(self) -> World:
        """The task's world, on which one can plan without the server."""
        return self.state.world

    @property
    def actions(self) -> tuple[GroundAction, ...]:
        """The valid actions of this seat."""
        return self.state.actions(self.seat) if self.seat else ()

    @property
    def running(self) -> bool:
        """Whether time runs: the game has begun, and does not stand still."""
        return self.phase == "running"

    @property
    def paused(self) -> bool:
        """Whether the game stands still; `pause` says why."""
        return self.phase == "paused"

    @property
    def seen(self) -> messages.Seen | None:
        """What a server need not tell again; None before the first picture."""
        if self._reader is None and self.observation is None:
            return None
        return messages.Seen(
            episode=self.episode, step=self.step, said=self.said, stale=self._resyncing
        )

    @property
    def over(self) -> bool:
        """Whether the episode has an outcome."""
        return self.outcome is not None

    @property
    def my_move(self) -> bool:
        """Whether this seat may act in the present step."""
        if not self.running or self.seat is None or self.turn not in (None, self.seat):
            return False
        return not self.has_state or self.state.busy_steps(self.seat) == 0

    # Acting

    def submit(
        self, wish: Wish, *, think_ms: int = 0, reasoning: str | None = None
    ) -> asyncio.Future[ActResult]:
        """Send an action (None: do nothing); the future tells what became of it.

        It stays pending while the connection is away: the action is sent again, and not done
        twice.
        """
        if self.seat is None:
            raise ProtocolError("seat/none", "spectators do not act")
        self._seq += 1
        act = messages.Act(
            seq=self._seq,
            action=_wire_action(wish),
            basis=self.step,
            think_ms=think_ms,
            reasoning=reasoning,
        )
        loop = asyncio.get_running_loop()
        future = loop.create_future()
        if self.ended:
            future.set_result(ActResult(False, self.step, ("it is over",), "episode/over"))
            return future
        self._waiting[act.seq] = future
        self._unanswered = {act.seq: act}
        self._sent_at = loop.time()
        self._send(act)
        return future

    async def act(
        self, wish: Wish, *, think_ms: int = 0, reasoning: str | None = None
    ) -> ActResult:
        """Send an action and wait until it was taken into a step or rejected."""
        return await self.submit(wish, think_ms=think_ms, reasoning=reasoning)

    def say(self, text: str) -> None:
        """Say something to everybody in the episode."""
        self._send(messages.Say(text=text))

    # Events

    def __aiter__(self) -> AsyncIterator[GameEvent]:
        return self._iterate()

    async def _iterate(self) -> AsyncIterator[GameEvent]:
        """Events as they come, until the episode is over."""
        while True:
            event = await self.next_event()
            yield event
            if isinstance(event, Over):
                return

    async def next_event(self) -> GameEvent:
        """The next thing that happens."""
        while not self._events:
            self._news.clear()
            await self._news.wait()
        return self._events.popleft()

    def poll(self) -> list[GameEvent]:
        """What has happened since this was last asked, without waiting."""
        events = list(self._events)
        self._events.clear()
        return events

    # Messages

    def receive(self, message: messages.ServerMessage, now: float) -> None:
        """Take a message of the server into account."""
        match message:
            case messages.Snapshot():
                self._snapshot(message, now)
            case messages.Delta():
                self._delta(message, now)
            case messages.Observation():
                self._observe(message, now)
            case messages.Rejected():
                self._rejected(message)
            case messages.Said():
                if message.number > self.said or message.number == 0:
                    self.said = max(self.said, message.number)
                    self._emit(Heard(message.name, message.seat, message.text))
            case messages.Notice():
                self._emit(Announced(message.text))
            case messages.Roster():
                self.phase, self.seats = message.phase, tuple(message.seats)
                self.turn, self.pause = message.turn, message.pause
                self.waits_for = tuple(message.waits_for)
                self._emit(RosterChanged(message.phase, self.seats, message.pause, self.waits_for))
            case messages.Ended():
                self._finish(message.outcome)
            case messages.Left():
                self._give_up(message.reason)
            case messages.Bye():
                self._give_up(message.reason, message.code)
            case _:
                pass

    def rejoined(self, joined: messages.Joined, *, anew: bool = False) -> None:
        """The connection is back: send again what is not answered by what was missed.

        `anew` says that the seat was lost and taken again: nobody knows what became of earlier
        actions, so they are not repeated.
        """
        self.name = joined.name
        self._seq = max(self._seq, joined.seq)
        self._resyncing = False
        self._resync_asked = 0
        if anew:
            for seq in list(self._waiting):
                reason = "the seat was lost and taken anew"
                self._resolve(seq, ActResult(False, self.step, (reason,), "seat/lost"))
        self._catch_up = joined.step
        self._caught_up()

    def _caught_up(self) -> None:
        """After what was missed, ask what became of the last action."""
        if self._catch_up is not None and self._catch_up <= self.step:
            self._catch_up = None
            for act in self._unanswered.values():
                self._send(act)

    def _send_again(self, seq: int) -> None:
        """The server had had enough messages for a while."""
        if seq in self._unanswered and not self.ended:
            self._send(self._unanswered[seq])

    def awaits(self, act: messages.Act) -> bool:
        """Whether an action has no answer yet."""
        return self._unanswered.get(act.seq) is act

    def repeat(self, before: float) -> None:
        """Send again what was sent before a time and has no answer; it acts once all the same."""
        if self._sent_at <= before and not self.ended:
            for act in self._unanswered.values():
                self._send(act)

    def _snapshot(self, message: messages.Snapshot, now: float) -> None:
        if self._reader is not None and message.step < self.step:
            return
        if message.task is not None:
            world = shared_world(Task.from_json(message.task, "the server's task"))
        elif self._reader is not None:
            world = self._reader.world
        else:
            raise ProtocolError("state/mismatch", "a snapshot without its task")
        values = message.model_dump(include={"facts", "timers", "busy"})
        tables = message.model_dump(include={"predicates", "objects", "atoms"})
        self._reader = StateReader(world, tables, values)
        if self._reader.state.digest != message.hash:
            raise ProtocolError("state/mismatch", "the snapshot's state has another hash")
        self._resyncing = False
        self.step, self.phase, self.turn = message.step, message.phase, message.turn
        self.seats, self.clock = tuple(message.seats), message.clock
        self.left, self.step_time = message.left, now
        self.pause = message.pause
        self._seq = max(self._seq, message.seq)
        reasons = tuple(message.last_reasons)
        code = "action/invalid" if reasons else ""
        self._settle(message.last_seq, ActResult(not reasons, message.last_step, reasons, code))
        self._emit(Changed(message.step, self.state, turn=message.turn))
        self._caught_up()
        if message.outcome is not None:
            self._finish(message.outcome)

    def _delta(self, message: messages.Delta, now: float) -> None:
        if self._reader is None:
            return
        if self._resyncing:
            # The snapshot is on its way; ask again if the request was lost.
            self._resync_asked += 1
            if self._resync_asked % 20 == 0:
                self._send(messages.Resync())
            return
        if message.step <= self.step:
            return
        if message.step != self.step + 1:
            self._resync()
            return
        previous = self.state
        try:
            state = self._reader.apply(message.model_dump(exclude_defaults=True))
        except ProtocolError:
            self._resync()
            return
        if message.hash is not None and state.digest != message.hash:
            self._resync()
            return
        self.step, self.turn = message.step, message.turn
        self.left, self.step_time = None, now
        did = self._did(message)
        self._tally(did)
        self._answer(message)
        self._emit(Changed(message.step, state, previous, did, message.turn))
        self._caught_up()

    def _tally(self, did: tuple[tuple[str, GroundAction, bool], ...]) -> None:
        """Count what each seat has done since the roster last came."""
        done = {player: applied for player, _, applied in did}
        self.seats = tuple(
            seat.model_copy(
                update={"applied": seat.applied + 1}
                if done[seat.player]
                else {"rejected": seat.rejected + 1}
            )
            if seat.player in done
            else seat
            for seat in self.seats
        )

    def _did(self, message: messages.Delta) -> tuple[tuple[str, GroundAction, bool], ...]:
        rows = []
        for i, (seat, name, *arguments) in enumerate(message.did):
            player = self.world.players[int(seat)]
            action = self.world.action(str(name), *map(str, arguments))
            rows.append((player, action, str(i) not in message.unmet))
        return tuple(rows)

    def _answer(self, message: messages.Delta) -> None:
        for i, (row, seq) in enumerate(zip(message.did, message.seq, strict=True)):
            if self.world.players[int(row[0])] == self.seat:
                reasons = tuple(message.unmet.get(str(i), ()))
                code = "action/invalid" if reasons else ""
                self._settle(seq, ActResult(not reasons, message.step, reasons, code))
        # A decision to do nothing is answered by the step in which nothing was done.
        for seq, act in list(self._unanswered.items()):
            if act.action is None:
                self._settle(seq, ActResult(True, message.step))

    def _observe(self, message: messages.Observation, now: float) -> None:
        if self.has_state:
            if message.step > self.step and not self._resyncing:
                self._resync()
        elif message.step < self.step:
            return
        else:
            self.step, self.turn, self.phase = message.step, message.turn, message.phase
            self.step_time = now
        observed = Observed(message.step, message.text, tuple(message.actions), message.turn)
        self.observation = observed
        self._emit(observed)
        if not self.has_state:
            reasons = tuple(message.reasons)
            code = "action/invalid" if reasons else ""
            self._settle(message.seq, ActResult(not reasons, message.step, reasons, code))
            self._caught_up()

    def _rejected(self, message: messages.Rejected) -> None:
        if message.code == "rate/limited" and message.seq in self._unanswered:
            loop = asyncio.get_running_loop()
            loop.call_later(SLOW_DOWN_SECONDS, self._send_again, message.seq)
            return
        reasons = tuple(message.reasons)
        self._resolve(message.seq, ActResult(False, message.step, reasons, message.code))
        self._emit(Refused(message.seq, message.step, message.action, reasons, message.code))

    def _finish(self, outcome: Mapping[str, Any]) -> None:
        self.outcome, self.phase = outcome, "over"
        self._give_up(str(outcome.get("reason", "")))

    def _give_up(self, reason: str, code: str = "") -> None:
        if self.ended:
            return
        self.ended, self.farewell = True, reason
        for seq in list(self._waiting):
            self._resolve(seq, ActResult(False, self.step, (reason,), "episode/over"))
        self._emit(Over(self.outcome or {}, reason, code))

    def _settle(self, seq: int, result: ActResult) -> None:
        """The fate of action `seq` is known; those before it were replaced."""
        for earlier in [s for s in self._waiting if s < seq]:
            reasons = (f"superseded by action {seq}",)
            self._resolve(earlier, ActResult(False, result.step, reasons, "action/invalid"))
        self._resolve(seq, result)

    def _resolve(self, seq: int, result: ActResult) -> None:
        self._unanswered.pop(seq, None)
        future = self._waiting.pop(seq, None)
        if future is not None and not future.done():
            future.set_result(result)

    def _resync(self) -> None:
        self._resyncing = True
        self._resync_asked = 0
        self._send(messages.Resync())

    def _emit(self, event: GameEvent) -> None:
        self._events.append(event)
        self._news.set()


def _wire_action(wish: Wish) -> messages.NamedAction | str | int | None:
    if isinstance(wish, GroundAction):
        return messages.NamedAction(name=wish.name, args=list(wish.arguments))
    return wish
