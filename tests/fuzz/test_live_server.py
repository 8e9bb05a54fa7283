"""Hostile and honest messages in any order on a live server. It replies, nothing fails inside it,
and the episode of two honest players continues undisturbed.
"""

from __future__ import annotations

import asyncio
import logging
import shutil
import tempfile
import traceback
from collections.abc import AsyncIterator, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
import structlog
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from robotouille.replay.recording import read_recording
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.codes import documented_codes
from tests.support.fuzzing.specimens import client_messages
from tests.support.fuzzing.wire import (
    BINARY,
    CLOSE,
    CONTINUATION,
    TEXT,
    Closed,
    Wire,
    frame,
    hostile_frames,
    hostile_request,
)
from tests.support.servers import Raw, raw, serving
from tests.support.thorough import thorough
from tests.support.virtual_time import VirtualTimeLoop

SEEDS = st.integers(0, 2**32)
STRANGERS = 4


class Failures(logging.Handler):
    """Collector of everything that would be an error in the server's log."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.rows: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Record an error, except for errors inside the WebSocket library caused by a peer."""
        cause = record.exc_info[1] if record.exc_info else None
        if cause is None or _passed_through_the_server(cause):
            self.rows.append(f"{record.getMessage()}: {cause!r}")

    def structured(self, _: Any, method: str, row: dict[str, Any]) -> dict[str, Any]:
        if method in ("error", "exception", "critical"):
            self.rows.append(str(row))
        raise structlog.DropEvent

    def loop(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        self.rows.append(str(context))


def _passed_through_the_server(cause: BaseException) -> bool:
    frames = traceback.walk_tb(cause.__traceback__)
    return any("robotouille" in frame.f_globals.get("__name__", "") for frame, _ in frames)


@asynccontextmanager
async def watched() -> AsyncIterator[Failures]:
    """Collect failures of the server within the context."""
    failures = Failures()
    logger = logging.getLogger("websockets.server")
    before, config = logger.level, structlog.get_config()
    logger.addHandler(failures)
    logger.setLevel(logging.ERROR)
    structlog.configure(processors=[failures.structured])
    asyncio.get_running_loop().set_exception_handler(failures.loop)
    try:
        yield failures
    finally:
        structlog.configure(**config)
        logger.removeHandler(failures)
        logger.setLevel(before)


class Stranger:
    """One hostile connection at a time, and the server's replies to it."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.wire: Wire | None = None
        self.greeted = False
        self.tidy = True
        self._listening: asyncio.Task[None] | None = None
        self.codes: set[str] = set()
        self.refs: set[int] = set()
        self.resume = ""

    async def connect(self, *, text: bool, named: bool) -> None:
        await self.vanish()
        self.wire = await Wire.open(self.port)
        self.tidy = True
        try:
            assert await self.wire.upgrade(text=text, named=named) == 101
        except Closed:
            self.wire = None
            return
        self._listening = asyncio.create_task(self._listen(self.wire))

    async def _listen(self, wire: Wire) -> None:
        with suppress(Closed):
            async for message in wire.messages():
                self.refs.add(message.get("ref", 0))
                if "code" in message and message["type"] in ("error", "rejected"):
                    self.codes.add(message["code"])
                self.greeted |= message["type"] == "welcome"
                self.resume = message.get("resume", self.resume)
        wire.cut()
        self.wire = None

    async def say(self, data: bytes) -> None:
        if self.wire is not None:
            with suppress(Closed):
                await self.wire.write(data)

    async def vanish(self) -> None:
        if self.wire is not None:
            self.wire.cut()
        if self._listening is not None:
            await self._listening
        self.wire = self._listening = None
        self.greeted = False


class HostileClients(RuleBasedStateMachine):
    """Two honest players in one kitchen, and hostile clients that connect and join."""

    def __init__(self) -> None:
        super().__init__()
        self._runner = asyncio.Runner(loop_factory=VirtualTimeLoop)
        self._stack = AsyncExitStack()
        self._folder = Path(tempfile.mkdtemp())
        self._recordings = self._folder / "recordings"
        self._step = 0
        self._run(self._open())

    def _run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return self._runner.run(work)

    async def _open(self) -> None:
        self.failures = await self._stack.enter_async_context(watched())
        self.server = await self._stack.enter_async_context(
            serving(self._recordings, messages_per_second=100_000, max_steps=100_000)
        )
        self.honest: list[Raw] = [
            await self._stack.enter_async_context(raw(self.server, text=text))
            for text in (True, False)
        ]
        order = {"type": "create", "task": "multi_agent/01", "clock": "lockstep"}
        created = await self.honest[0].ask(order, "created")
        self.code = created["code"]
        for player in self.honest:
            joined = await player.ask({"type": "join", "episode": self.code}, "joined")
            assert joined["type"] == "joined", joined
            await player.expect("snapshot")
        self.strangers = [Stranger(self.server.port) for _ in range(STRANGERS)]

    # Actions of strangers

    @rule(who=st.integers(0, STRANGERS - 1), text=st.booleans(), named=st.booleans())
    def a_stranger_connects(self, who: int, text: bool, named: bool) -> None:
        self._run(self.strangers[who].connect(text=text, named=named))

    @rule(who=st.integers(0, STRANGERS - 1), again=st.booleans())
    def a_stranger_says_hello(self, who: int, again: bool) -> None:
        stranger = self.strangers[who]
        hello = {"type": "hello", "protocol": 1, "name": f"eve{who}"}
        if again and stranger.resume:
            hello["resume"] = stranger.resume
        self._say(stranger, hello)

    @rule(who=st.integers(0, STRANGERS - 1), view=st.sampled_from(["state", "text", "both"]))
    def a_stranger_watches(self, who: int, view: str) -> None:
        watch = {"type": "join", "episode": self.code, "role": "spectator", "view": view}
        self._say(self.strangers[who], watch)

    @rule(who=st.integers(0, STRANGERS - 1), seed=SEEDS)
    def a_stranger_sends_a_message(self, who: int, seed: int) -> None:
        adversary, stranger = Adversary(seed), self.strangers[who]
        if stranger.wire is not None:
            self._run(stranger.say(_message(adversary, stranger.wire, self.code)))

    @rule(who=st.integers(0, STRANGERS - 1), seed=SEEDS)
    def a_stranger_breaks_the_frames(self, who: int, seed: int) -> None:
        adversary, stranger = Adversary(seed), self.strangers[who]
        opcode = adversary.random.choice((TEXT, BINARY))
        payload = adversary.json_text(adversary.message(client_messages())).encode()
        stranger.tidy = False
        self._run(stranger.say(hostile_frames(adversary, payload, opcode)))

    @rule(who=st.integers(0, STRANGERS - 1), pieces=st.integers(1, 40))
    def a_stranger_sends_a_message_in_pieces(self, who: int, pieces: int) -> None:
        stranger = self.strangers[who]
        empty = frame(b"", CONTINUATION, fin=False) * pieces
        whole = frame(b'{"type":', TEXT, fin=False) + empty + frame(b'"list"}', CONTINUATION)
        self._run(stranger.say(whole))

    @rule(seed=SEEDS, polite=st.booleans())
    def a_stranger_sends_a_bad_handshake(self, seed: int, polite: bool) -> None:
        """Send half a handshake, garbage or another protocol, then disconnect."""

        async def knock() -> None:
            wire = await Wire.open(self.server.port)
            with suppress(Closed):
                await wire.write(hostile_request(Adversary(seed)))
            await (wire.close() if polite else _after(0.5, wire.cut))

        self._run(knock())

    @rule(who=st.integers(0, STRANGERS - 1), polite=st.booleans())
    def a_stranger_goes(self, who: int, polite: bool) -> None:
        stranger = self.strangers[who]
        if polite:
            self._run(stranger.say(frame(b"\x03\xe8", CLOSE)))
        self._run(stranger.vanish())

    @rule(seconds=st.sampled_from([0.1, 3, 12, 40]))
    def time_passes(self, seconds: float) -> None:
        self._run(asyncio.sleep(seconds))

    def _say(self, stranger: Stranger, message: dict[str, Any]) -> None:
        if stranger.wire is not None:
            self._run(stranger.say(stranger.wire.encode(message)))

    # Invariants

    @rule()
    def the_honest_game_goes_on(self) -> None:
        self._step += 1

        async def play() -> None:
            for player in self.honest:
                await player.send({"type": "act", "seq": self._step, "action": None})
            for player in self.honest:
                step = await player.expect("delta", "snapshot", "ended", "bye", "error")
                assert (step["type"], step["step"]) == ("delta", self._step), step

        self._run(play())

    @precondition(lambda self: any(s.greeted and s.tidy and s.wire for s in self.strangers))
    @rule(ref=st.integers(1, 2**31 - 1))
    def a_stranger_is_still_answered(self, ref: int) -> None:
        """Check the reply, unless the last frame was incomplete and the server waits for it."""
        stranger = next(s for s in self.strangers if s.greeted and s.tidy and s.wire)
        self._say(stranger, {"type": "list", "ref": ref})
        for _ in range(20):
            self._run(asyncio.sleep(0.1))
            if ref in stranger.refs or stranger.wire is None:
                return
        raise AssertionError(f"no reply to {ref}")

    def teardown(self) -> None:
        try:
            self.the_honest_game_goes_on()
            self._run(self._leave_all())
            seen = set().union(*(stranger.codes for stranger in self.strangers))
            assert seen <= documented_codes(), seen - documented_codes()
            assert "server/internal" not in seen
            assert not self.failures.rows, self.failures.rows
        finally:
            self._run(self._stack.aclose())
            self._runner.close()
            recordings = list(self._recordings.glob("*.rbt*"))
            assert recordings
            assert all(read_recording(path).verify().ok for path in recordings)
            shutil.rmtree(self._folder)

    async def _leave_all(self) -> None:
        for stranger in self.strangers:
            await stranger.vanish()
        for player in self.honest:
            await player.socket.close()
        for _ in range(20):
            await asyncio.sleep(1)
            page = self.server.metrics.page().decode()
            if "\nrobotouille_connections 0.0\n" in page:
                return
        raise AssertionError("connections remain open")


def _message(adversary: Adversary, wire: Wire, code: str) -> bytes:
    """Return a hostile message, mostly in this connection's subprotocol."""
    message = adversary.message(client_messages())
    if isinstance(message, dict) and message.get("type") == "join":
        message["episode"] = code
    text = wire.text != (adversary.random.random() < 0.05)
    if text:
        return frame(adversary.json_text(message).encode(), TEXT)
    return frame(adversary.packed(message), BINARY)


async def _after(seconds: float, then: Any) -> None:
    await asyncio.sleep(seconds)
    then()


HostileClients.TestCase.settings = thorough(15, stateful_step_count=40)
TestHostileHouse = pytest.mark.slow(HostileClients.TestCase)
