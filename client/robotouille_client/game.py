"""An episode to play in with asyncio: actions and events that one can await."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable

from robotouille.protocol import messages
from robotouille_client.sansio.game_events import ActResult, GameEvent, Over
from robotouille_client.sansio.game_replica import PRESENT, GameReplica
from robotouille_client.sansio.sent_actions import ActionRequest

__all__ = ["ActionRequest", "Game"]


class Game(GameReplica):
    """One episode: its state, its events, and what one does in it; made by `Client.join`."""

    def __init__(self, joined: messages.Joined, flush: Callable[[], None]) -> None:
        super().__init__(joined)
        self._flush = flush
        self._futures: dict[int, asyncio.Future[ActResult]] = {}
        self._news = asyncio.Event()

    def submit(
        self,
        action: ActionRequest,
        seat: str | None = None,
        *,
        think_ms: int = 0,
        basis: int | None = PRESENT,
        reasoning: str | None = None,
        anticipates: bool = False,
        waits: bool = False,
    ) -> asyncio.Future[ActResult]:
        """Send an action (None: do nothing); the future tells what became of it.

        It stays pending while the connection is away: the action is sent again, and not done
        twice.

        Args:
            action: A ground action, its name and arguments, its sentence, or its place in the list
                of valid ones.
            seat: The one of one's seats that acts; the first if None.
            think_ms: Milliseconds of thought, which count where thinking is declared.
            basis: The step on which the choice was made, for the recording; the present one if
                nothing is said, and left open if None.
            reasoning: Is recorded, and shown to nobody; at most 8,000 characters.
            anticipates: It need not be valid yet: another's action in the same step is to make it
                so. A server that does not know this rejects it where it is not.
            waits: With no action: one waits for a place or for somebody. It is recorded, and not
                counted as idle.

        Raises:
            ProtocolError: `seat/none`: spectators do not act; `seat/unknown`: it is not one's own.
            ValueError: The message cannot have such an argument.
        """
        loop = asyncio.get_running_loop()
        seq = self.propose(
            action,
            loop.time(),
            seat=seat,
            think_ms=think_ms,
            basis=basis,
            reasoning=reasoning,
            anticipates=anticipates,
            waits=waits,
        )
        future = self._futures[seq] = loop.create_future()
        self.wake()
        self._flush()
        return future

    async def act(
        self,
        action: ActionRequest,
        seat: str | None = None,
        *,
        think_ms: int = 0,
        basis: int | None = PRESENT,
        reasoning: str | None = None,
        anticipates: bool = False,
        waits: bool = False,
    ) -> ActResult:
        """Send an action and wait until it was taken into a step or rejected.

        Arguments are those of `submit`.

        Raises:
            ProtocolError: `seat/none`: spectators do not act; `seat/unknown`: it is not one's own.
            ValueError: The message cannot have such an argument.
        """
        return await self.submit(
            action,
            seat=seat,
            think_ms=think_ms,
            basis=basis,
            reasoning=reasoning,
            anticipates=anticipates,
            waits=waits,
        )

    def ready(self, ready: bool = True) -> None:
        """Say that the game may begin, after `Client.join(…, ready=False)`; False takes it back.

        It begins when all are there and ready. Once it has, this means nothing; a server of
        before has begun without.

        Raises:
            ProtocolError: `seat/none`: spectators are not waited for.
        """
        super().ready(ready)
        self._flush()

    def say(self, text: str) -> None:
        """Say something to everybody in the episode.

        Raises:
            ValueError: The text has not 1 to 500 characters.
        """
        super().say(text)
        self._flush()

    def note(self, topic: str, text: str, seat: str | None = None) -> None:
        """Have a text recorded that nobody is told; a long one is sent in pieces.

        Args:
            topic: What it is about.
            text: Of any length; a server takes about 200 KiB a second.
            seat: The one of one's seats whose it is; the first if None.

        Raises:
            ProtocolError: `seat/unknown`: it is not one's own.
            ValueError: The topic has not 1 to 64 characters.
        """
        super().note(topic, text, seat)
        self._flush()

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
        """The next thing that happens, once it does; nothing comes after `Over`."""
        while not self._events:
            self._news.clear()
            await self._news.wait()
        return self._events.popleft()

    def wake(self) -> None:
        """Tell those who wait for an event, or for what became of an action."""
        for seq, result in self.results():
            future = self._futures.pop(seq, None)
            if future is not None and not future.done():
                future.set_result(result)
        if self._events:
            self._news.set()
