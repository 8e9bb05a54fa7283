"""An episode for asyncio programs: actions and events that can be awaited."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Unpack

from robotouille.protocol import messages
from robotouille_client.sansio.game_events import ActResult, GameEnded, GameEvent
from robotouille_client.sansio.game_replica import GameReplica
from robotouille_client.sansio.sent_actions import ActDetails, RequestedAction

__all__ = ["ActDetails", "Game", "RequestedAction"]


class Game(GameReplica):
    """One episode: its state, its events and its participant's requests.

    `Client.join` returns it.
    """

    def __init__(self, joined: messages.Joined, flush: Callable[[], None]) -> None:
        super().__init__(joined)
        self._flush = flush
        self._futures: dict[int, asyncio.Future[ActResult]] = {}
        self._new_events = asyncio.Event()

    def submit(
        self, action: RequestedAction, seat: str | None = None, **details: Unpack[ActDetails]
    ) -> asyncio.Future[ActResult]:
        """Send an action and return a future with its result.

        The future stays pending while the connection is lost. The action is then sent again, and
        executed once.

        Args:
            action: A ground action, its name and arguments, its sentence, its position in the
                list of valid actions, or None to do nothing.
            seat: The client's seat that acts; the first one by default.
            details: `think_ms`, `basis`, `max_age`, `reasoning`, `anticipates` and `waits`, as
                described in `ActDetails`.

        Raises:
            ProtocolError: `seat/none`: spectators cannot act; `seat/unknown`: the client does
                not have this seat.
            ValueError: The message does not allow one of the details.
        """
        loop = asyncio.get_running_loop()
        seq = self.propose(action, loop.time(), seat, **details)
        future = self._futures[seq] = loop.create_future()
        self.wake()
        self._flush()
        return future

    async def act(
        self, action: RequestedAction, seat: str | None = None, **details: Unpack[ActDetails]
    ) -> ActResult:
        """Send an action, wait until it is applied or rejected, and return its result.

        Arguments and errors are the same as those of `submit`.
        """
        return await self.submit(action, seat, **details)

    def ready(self, ready: bool = True) -> None:
        """Tell the server that the game may begin, after `Client.join(…, ready=False)`.

        The game begins when all seats are taken and ready. False withdraws the readiness. Both
        have no effect once the game has begun, and on servers without this feature.

        Raises:
            ProtocolError: `seat/none`: games do not wait for spectators.
        """
        super().ready(ready)
        self._flush()

    def say(self, text: str) -> None:
        """Send a chat message to all participants.

        Raises:
            ValueError: The text does not have 1 to 500 characters.
        """
        super().say(text)
        self._flush()

    def signal(self, intent: str, target: str = "", seat: str | None = None) -> None:
        """Send a signal to all participants; see `GameReplica.signal`."""
        super().signal(intent, target, seat)
        self._flush()

    def note(self, topic: str, text: str, seat: str | None = None) -> None:
        """Add a text to the recording, which people do not see.

        Args:
            topic: The topic of the note.
            text: Text of any length, sent in pieces. A server accepts about 200 KiB/s.
            seat: The client's seat that the note belongs to; the first one by default.

        Raises:
            ProtocolError: `seat/unknown`: the client does not have this seat.
            ValueError: The topic does not have 1 to 64 characters.
        """
        super().note(topic, text, seat)
        self._flush()

    def __aiter__(self) -> AsyncIterator[GameEvent]:
        return self._iterate()

    async def _iterate(self) -> AsyncIterator[GameEvent]:
        while True:
            event = await self.next_event()
            yield event
            if isinstance(event, GameEnded):
                return

    async def next_event(self) -> GameEvent:
        """Wait for the next event and return it. No event follows `GameEnded`."""
        while not self._events:
            self._new_events.clear()
            await self._new_events.wait()
        return self._events.popleft()

    def wake(self) -> None:
        """Resolve the futures of decided actions and wake up waiters for events."""
        for seq, result in self.results():
            future = self._futures.pop(seq, None)
            if future is not None and not future.done():
                future.set_result(result)
        if self._events:
            self._new_events.set()
