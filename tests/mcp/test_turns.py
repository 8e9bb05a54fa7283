"""Turns of the requests of a token."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import pytest
from starlette.responses import PlainTextResponse
from starlette.types import Message, Receive, Scope, Send

from robotouille_client.mcp_server import turns
from robotouille_client.mcp_server.open_games import OpenGames
from robotouille_client.mcp_server.sessions import SessionKeeper
from robotouille_client.mcp_server.turns import TURNS_AT_ONCE, Turn, Turns, waiting

PASSES = 20
PATIENCE = 30.0
"""Seconds after which a place counts as lost."""


class Trusting(OpenGames):
    """Open games of a game server that accepts all tokens."""

    @asynccontextmanager
    async def visit(self, caller: Any) -> AsyncIterator[Any]:
        yield None


class Served:
    """Application that takes a while, and its requests by token."""

    def __init__(self) -> None:
        self.now = Counter[str]()
        self.most = Counter[str]()
        self.most_at_once = 0
        self.done = 0
        self._keeper = SessionKeeper(self, Trusting("ws://127.0.0.1:9"), 600, lambda: 0.0)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        token = dict(scope["headers"]).get(b"authorization", b"").decode()
        self.now[token] += 1
        self.most[token] = max(self.most[token], self.now[token])
        self.most_at_once = max(self.most_at_once, self.now.total())
        for _ in range(PASSES):
            await asyncio.sleep(0)
        self.now[token] -= 1
        await PlainTextResponse("done")(scope, receive, send)

    def ask(
        self, token: str = "", session: str = "", method: str = "POST", *, gone: bool = False
    ) -> asyncio.Task[None]:
        """Send a request. The client of one that is `gone` then closes its connection."""
        headers = {"authorization": f"Bearer {token}" if token else "", "mcp-session-id": session}
        raw = [(name.encode(), value.encode()) for name, value in headers.items() if value]
        scope = {"type": "http", "method": method, "headers": raw, "client": ("127.0.0.1", 1)}
        whole: list[Message] = [{"type": "http.request", "body": b"", "more_body": False}]

        async def receive() -> Message:
            if not whole and not gone:
                await asyncio.Event().wait()
            return whole.pop() if whole else {"type": "http.disconnect"}

        return asyncio.create_task(self._keeper(scope, receive, self._send))

    async def _send(self, message: Message) -> None:
        self.done += message["type"] == "http.response.start"


async def test_a_few_requests_of_one_token_are_served_at_once_and_all_in_turn() -> None:
    served = Served()
    await served.ask("eve")
    await served.ask("ada")
    crowd = [served.ask("eve") for _ in range(60)]
    for _ in range(PASSES):
        await asyncio.sleep(0)
    await served.ask("ada")
    assert served.done < 30
    await asyncio.gather(*crowd)
    assert served.most["Bearer eve"] == TURNS_AT_ONCE


async def test_a_request_waits_for_one_request_of_each_other_token() -> None:
    ours, begun = Turns(), list[str]()

    async def call(token: str) -> None:
        async with ours.turn(token):
            begun.append(token)
            for _ in range(PASSES):
                await asyncio.sleep(0)

    crowd = [asyncio.create_task(call(f"eve-{n % 4}")) for n in range(240)]
    await asyncio.sleep(0)
    before = len(begun)
    await call("ada")
    assert len(begun) - before <= 6
    await asyncio.gather(*crowd)
    assert len(begun) == len(crowd) + 1


async def test_tokens_share_the_places() -> None:
    served = Served()
    tokens = ("ada", "eve", "bob")
    for token in tokens:
        await served.ask(token)
    await asyncio.gather(*(served.ask(token) for token in tokens * 10))
    assert served.most_at_once == TURNS_AT_ONCE


async def test_strangers_are_refused_one_in_a_pass_of_the_event_loop() -> None:
    served = Served()
    strangers = [served.ask(f"made-up-{number}", "unknown") for number in range(100)]
    for _ in range(PASSES):
        await asyncio.sleep(0)
    assert 0 < served.done <= PASSES
    await asyncio.gather(*strangers)
    assert served.done == len(strangers)
    assert not served.most


async def test_requests_that_are_never_answered_keep_no_turns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(turns, "TURN_SECONDS", 0.0)
    ours = Turns()
    begun = []
    async with asyncio.timeout(PATIENCE), AsyncExitStack() as stack:
        while len(begun) < 3 * TURNS_AT_ONCE:
            begun.append(await stack.enter_async_context(ours.turn("ada")))
    assert len({*begun}) == 3 * TURNS_AT_ONCE


@pytest.mark.parametrize("token", ["", "ada"])
async def test_requests_abandoned_before_their_turn_are_not_served(token: str) -> None:
    """Each call with the id of another one took 0.05 s: 6,700 calls blocked others for 84 s."""
    served = Served()
    await served.ask(token)
    await asyncio.gather(*(served.ask(token, gone=True) for _ in range(50)))
    assert served.done == 1
    await served.ask(token)
    await served.ask(token, method="DELETE", gone=True)
    assert served.done == 3


async def test_cancelled_requests_keep_no_turns() -> None:
    ours = Turns()

    async def hold() -> None:
        async with ours.turn("ada"):
            await asyncio.Event().wait()

    for after in range(4):
        held = [asyncio.create_task(hold()) for _ in range(3 * TURNS_AT_ONCE)]
        for _ in range(after):
            await asyncio.sleep(0)
        for each in held:
            each.cancel()
        await asyncio.gather(*held, return_exceptions=True)
    async with asyncio.timeout(PATIENCE), ours.turn("ada") as turn:
        assert isinstance(turn, Turn)


async def test_a_call_that_waits_leaves_its_turn_and_waits_for_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(turns, "TURN_SECONDS", 3600.0)
    ours, answered, order = Turns(), asyncio.Event(), list[str]()

    async def call() -> None:
        async with ours.turn("ada"):
            async with waiting():
                order.append("waits")
                await answered.wait()
            order.append("goes on")

    async def other() -> None:
        async with ours.turn("bob"):
            answered.set()
            for _ in range(3):
                await asyncio.sleep(0)
            order.append("served")

    async with asyncio.timeout(PATIENCE):
        await asyncio.gather(call(), other())
    assert order == ["waits", "served", "goes on"]
