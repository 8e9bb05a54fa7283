"""Hostile connections to a real server, with their messages and the server's replies."""

from __future__ import annotations

import asyncio
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

from tests.programs.simulation.stranger import FLOODS
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.codes import documented_codes
from tests.support.fuzzing.specimens import client_messages
from tests.support.fuzzing.wire import (
    BINARY,
    TEXT,
    Closed,
    Wire,
    frame,
    hostile_frames,
    hostile_request,
)

__all__ = ["Siege", "ask_honestly"]

BATCH = 50
"""Messages sent before waiting for the server to process them."""
PATIENCE = 60.0
"""Seconds after which a missing reply counts as a hang."""
CLOSE_CODES = frozenset({None, 1000, 1001, 1002, 1003, 1007, 1008, 1009, 1012})
"""Allowed close codes of the server; 1011 would be an internal error."""
MAX_SILENT = 40
"""Largest number of silent or incomplete connections that stay open."""


@dataclass(slots=True)
class Siege:
    """Seeded attacker of the server on a port, with its `outcomes` and `faults`."""

    port: int
    adversary: Adversary
    outcomes: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    sent: int = 0
    _silent: list[Wire] = field(default_factory=list)
    _episodes: list[str] = field(default_factory=list)

    async def attack(self, messages: int) -> None:
        """Send this many messages over consecutive connections."""
        goal = self.sent + messages
        while self.sent < goal:
            try:
                async with asyncio.timeout(PATIENCE):
                    await self._one_connection(goal - self.sent)
            except TimeoutError:
                self.faults.append(f"no reply within {PATIENCE:g} s after {self.sent} messages")
                return
            except ConnectionRefusedError:
                self.faults.append(f"the server was gone after {self.sent} messages")
                return

    def withdraw(self) -> None:
        """Cut the connections that are still open."""
        while self._silent:
            self._silent.pop().cut()

    async def _one_connection(self, most: int) -> None:
        pick = self.adversary.random.random()
        if pick < 0.3:
            await self._knock()
        elif pick < 0.4:
            await self._stay_silent()
        elif pick < 0.41:
            await self._flood()
        else:
            await self._talk(most)

    # Before the handshake

    async def _knock(self) -> None:
        """Send an invalid or incomplete handshake."""
        self.sent += 1
        wire = await Wire.open(self.port)
        try:
            await wire.write(hostile_request(self.adversary))
            if self.adversary.random.random() < 0.5:
                async with asyncio.timeout(0.02):
                    status = (await wire.response()).split()[1].decode()
                    self.outcomes[f"http {status}"] += 1
                    if status == "500":
                        self.faults.append("HTTP status 500")
        except (Closed, TimeoutError, IndexError):
            self.outcomes["http none"] += 1
        finally:
            wire.cut()

    async def _stay_silent(self) -> None:
        """Send half a handshake or frame and stop, so that the server must time out."""
        self.sent += 1
        wire = await Wire.open(self.port)
        with suppress(Closed):
            if self.adversary.random.random() < 0.5:
                await wire.write(b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: ")
            elif await wire.upgrade(text=True) == 101:
                await wire.write(frame(b"x" * 60_000, TEXT)[: self.adversary.random.randrange(900)])
        self._silent.append(wire)
        self.outcomes["left hanging"] += 1
        if len(self._silent) > MAX_SILENT:
            self._silent.pop(0).cut()

    async def _flood(self) -> None:
        """Send far more of one kind of message than the limits allow."""
        self.sent += 1
        wire = await Wire.open(self.port)
        try:
            await wire.upgrade(text=True)
            await wire.write(FLOODS[self.adversary.random.choice(sorted(FLOODS))])
            async with asyncio.timeout(0.05):
                async for answer in wire.messages():
                    self._count(answer)
        except TimeoutError:
            self.outcomes["flood, still open"] += 1
        except Closed as closed:
            self.outcomes[f"flood, closed {closed.code}"] += 1
            if closed.code not in CLOSE_CODES:
                self.faults.append(f"closed with {closed.code}")
        finally:
            wire.cut()

    # After the handshake

    async def _talk(self, most: int) -> None:
        random = self.adversary.random
        wire = await Wire.open(self.port)
        try:
            text = random.random() < 0.5
            if await wire.upgrade(text=text, named=random.random() < 0.8) != 101:
                self.outcomes["not admitted"] += 1
                self.sent += 1
                return
            await self._enter(wire)
            for _ in range(random.randrange(1, 8)):
                if most > 0:
                    most -= await self._batch(wire, min(most, BATCH))
            if random.random() < 0.5:
                await self._break(wire)
        except Closed as closed:
            self.outcomes[f"closed {closed.code}"] += 1
            if closed.code not in CLOSE_CODES:
                self.faults.append(f"closed with {closed.code}")
        finally:
            wire.cut()

    async def _enter(self, wire: Wire) -> None:
        """Send `hello`, and mostly create and join an episode."""
        random = self.adversary.random
        await wire.ask({"type": "hello", "protocol": 1, "name": "eve", "kind": "bot"}, 1)
        if random.random() < 0.5 or not self._episodes:
            clock = random.choice(("turn", "lockstep", "realtime"))
            order = {"type": "create", "task": "synchronous/01", "clock": clock, "max_steps": 50}
            self._count(await wire.ask(order, 2))
        if self._episodes:
            episode = random.choice(self._episodes)
            view = random.choice(("state", "text", "both"))
            role = random.choice(("player", "player", "spectator"))
            join = {"type": "join", "episode": episode, "view": view, "role": role}
            answer = await wire.ask(join, 3)
            self._count(answer)
            if answer.get("code") in ("episode/ended", "episode/unknown"):
                self._episodes.remove(episode)

    async def _batch(self, wire: Wire, size: int) -> int:
        """Send hostile messages and wait until the server has processed the last one."""
        parts = [self._message(wire) for _ in range(size)]
        ref = self.adversary.random.randrange(1000, 2**31)
        parts.append(wire.encode({"type": "join", "episode": "none", "ref": ref}))
        self.sent += size
        writing = asyncio.create_task(wire.write(b"".join(parts)))
        try:
            async for answer in wire.messages():
                self._count(answer)
                if answer.get("ref") == ref:
                    break
        finally:
            with suppress(Closed):
                await writing
        return size

    def _count(self, answer: dict[str, object]) -> None:
        kind = str(answer["type"])
        code = answer.get("code", "action/invalid" if kind == "rejected" else "")
        if kind == "created":
            self._episodes.append(str(answer["episode"]))
        if kind not in ("error", "rejected"):
            self.outcomes[kind] += 1
            return
        self.outcomes[f"{kind} {code}"] += 1
        if code not in documented_codes() or code == "server/internal":
            self.faults.append(f"{kind} with the code {code}: {answer.get('message')}")

    def _message(self, wire: Wire) -> bytes:
        adversary = self.adversary
        message = adversary.message(client_messages())
        text = wire.text != (adversary.random.random() < 0.02)
        if text:
            return frame(adversary.json_text(message).encode(), TEXT)
        return frame(adversary.packed(message), BINARY)

    async def _break(self, wire: Wire) -> None:
        """Send invalid frames; the server closes, or waits for the rest of a frame."""
        payload = self.adversary.json_text({"type": "list"}).encode()
        self.sent += 1
        await wire.write(hostile_frames(self.adversary, payload, TEXT))
        with suppress(TimeoutError):
            async with asyncio.timeout(0.02):
                async for answer in wire.messages():
                    self._count(answer)


async def ask_honestly(port: int) -> str:
    """Connect an honest client and return the type of its reply to `list`, or "" on failure."""
    try:
        async with asyncio.timeout(PATIENCE):
            wire = await Wire.open(port)
            await wire.upgrade(text=True)
            await wire.ask({"type": "hello", "protocol": 1, "name": "ada"}, 1)
            answer = await wire.ask({"type": "list"}, 2)
            wire.cut()
            return str(answer["type"])
    except (TimeoutError, Closed, OSError):
        return ""
