"""What one can await in a game."""

from __future__ import annotations

import asyncio

from robotouille.protocol import messages
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import Announced, Over
from tests.support.scripted_server import ScriptedServer
from tests.support.virtual_time import run


class Table:
    """A game with its first snapshot, without a client; `flushed` counts what it wants sent."""

    def __init__(self) -> None:
        self.server = ScriptedServer()
        self.flushed = 0
        self.game = Game(self.server.joined(), self._flush)
        self.tell(self.server.snapshot())
        self.game.poll()

    def _flush(self) -> None:
        self.flushed += 1

    def tell(self, message: messages.ServerMessage) -> None:
        self.game.receive(message, 0.0)
        self.game.wake()


def test_an_action_is_awaited_until_it_is_answered() -> None:
    async def main() -> None:
        table = Table()
        acting = asyncio.create_task(table.game.act(table.game.actions[0]))
        await asyncio.sleep(0)
        assert table.flushed == 1
        assert not acting.done()
        table.tell(table.server.delta([table.game.actions[0]], seq=[1]))
        assert (await acting).applied

    run(main())


def test_an_action_that_nobody_waits_for_any_more_does_no_harm() -> None:
    async def main() -> None:
        table = Table()
        future = table.game.submit(None)
        future.cancel()
        table.tell(table.server.delta())
        assert future.cancelled()

    run(main())


def test_an_action_after_the_end_is_answered_at_once() -> None:
    async def main() -> None:
        table = Table()
        table.tell(messages.Left(episode="e1", reason="removed"))
        assert (await table.game.act(None)).code == "episode/over"

    run(main())


def test_events_come_until_the_end() -> None:
    async def main() -> None:
        table = Table()

        async def listen() -> list[object]:
            return [event async for event in table.game]

        listening = asyncio.create_task(listen())
        await asyncio.sleep(0)
        table.tell(messages.Notice(text="one"))
        await asyncio.sleep(0)
        table.tell(messages.Notice(text="two"))
        table.tell(messages.Left(episode="e1", reason="removed"))
        assert await listening == [Announced("one"), Announced("two"), Over({}, "removed")]

    run(main())


def test_what_is_said_is_flushed() -> None:
    async def main() -> None:
        table = Table()
        table.game.say("hello")
        assert table.flushed == 1
        assert table.game.messages_to_send() == [messages.Say(text="hello")]

    run(main())
