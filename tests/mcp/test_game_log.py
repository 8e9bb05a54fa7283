"""Texts of a server that reach an MCP client."""

from __future__ import annotations

import pytest
from mcp.server.mcpserver.exceptions import ToolError

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_client.game import Game
from robotouille_client.mcp_server.open_game import MAX_CHAT, MAX_LINES, GameLog
from robotouille_client.mcp_server.results import explained
from robotouille_client.sansio.game_events import Announced, ChatReceived
from tests.support.scripted_server import ScriptedServer


def test_unread_texts_are_limited_in_number_and_length() -> None:
    server = ScriptedServer()
    game = Game(server.joined(), lambda: None)
    game.receive(server.snapshot(), 0.0)
    log = GameLog(game)
    for number in range(100):
        log.take(ChatReceived("bob", "robot2", f"{number} {'x' * 10_000}"))
        log.take(Announced(f"{number} {'y' * 10_000}"))
    news = log.read()
    assert (len(news.chat), len(news.happened)) == (MAX_CHAT, MAX_LINES)
    assert news.left_out == 200 - MAX_CHAT - MAX_LINES
    assert {len(chat.text) for chat in news.chat} == {501}
    assert {len(line) for line in news.happened} == {1001}
    assert news.chat[-1].text.startswith("99 x")


def test_longest_chat_message_and_announcement_are_whole() -> None:
    server = ScriptedServer()
    game = Game(server.joined(), lambda: None)
    game.receive(server.snapshot(), 0.0)
    log = GameLog(game)
    game.receive(messages.Said(step=0, number=1, name="bob", text="x" * 500), 0.0)
    game.receive(messages.Notice(text="y" * 500), 0.0)
    for event in game.poll():
        log.take(event)
    news = log.read()
    assert [chat.text for chat in news.chat] == ["x" * 500]
    assert "y" * 500 in news.happened[-1]


def test_errors_are_limited_in_length() -> None:
    with pytest.raises(ToolError) as error, explained():
        raise ProtocolError("task/invalid", "x" * 10**6)
    assert 4000 < len(str(error.value)) < 5000
