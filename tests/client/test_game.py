"""Awaitable actions and events of a game."""

from __future__ import annotations

import asyncio

from robotouille.protocol import messages
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import Announced, GameEnded
from tests.support.scripted_server import ScriptedServer
from tests.support.virtual_time import virtual


class Table:
    """A game with its first snapshot but no client; `flushed` counts its requests to send."""

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


@virtual
async def test_act_returns_when_the_action_is_answered() -> None:
    table = Table()
    acting = asyncio.create_task(table.game.act(table.game.actions[0]))
    await asyncio.sleep(0)
    assert table.flushed == 1
    assert not acting.done()
    table.tell(table.server.delta([table.game.actions[0]], seq=[1]))
    assert (await acting).applied


@virtual
async def test_action_after_the_end_is_rejected_at_once() -> None:
    table = Table()
    table.tell(messages.Left(episode="e1", reason="removed"))
    assert (await table.game.act(None)).code == "episode/ended"


@virtual
async def test_iteration_ends_with_the_episode() -> None:
    table = Table()

    async def listen() -> list[object]:
        return [event async for event in table.game]

    listening = asyncio.create_task(listen())
    await asyncio.sleep(0)
    table.tell(messages.Notice(text="one"))
    await asyncio.sleep(0)
    table.tell(messages.Notice(text="two"))
    table.tell(messages.Left(episode="e1", reason="removed"))
    assert await listening == [Announced("one"), Announced("two"), GameEnded({}, "removed")]


@virtual
async def test_chat_is_flushed() -> None:
    table = Table()
    table.game.say("hello")
    assert table.flushed == 1
    assert table.game.messages_to_send() == [messages.Say(text="hello")]
