"""Whatever the server accepts from a client at its limits, readers of recordings accept."""

from __future__ import annotations

import asyncio
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from robotouille.episode.rules import MAX_DELAY_MS, MAX_LABELS
from robotouille.episode.submissions import MAX_HELD_REQUESTS
from robotouille.protocol import messages
from robotouille.replay.recording import Recording, read_recording
from robotouille_server.rooms.recording.journal import Journal
from tests.support.samples import quick_sample
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual

ALPHABETS = ("x", "é", "厨房", "🍔🥬", '"\\/', "a\u0301", "x\n\t ", "x\u202e", "x\x00\x7f", "ﷺ")
FAR = 2**53
"""Largest number in a message."""
ROBOT = "robot1"


def longest(model: type[BaseModel], field: str) -> int:
    """Return the number of characters that a field may have."""
    schema: dict[str, Any] = model.model_json_schema()["properties"][field]
    parts = (schema, *schema.get("anyOf", ()))
    return int(max(part["maxLength"] for part in parts if "maxLength" in part))


class Client:
    """Client that sends messages at the limits, which a seed determines."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.seq = 0

    def text(self, model: type[BaseModel], field: str) -> str:
        """Return a text of the longest length, or a short one."""
        most = longest(model, field)
        size = self.chance.choice((1, most - 1, most, most))
        return "".join(self.chance.choices(self.chance.choice(ALPHABETS), k=size))

    def created(self) -> dict[str, Any]:
        labels = {f"{number:064}": "🍔" * 64 for number in range(MAX_LABELS)}
        delay = {"delay_ms": self.chance.choice((0, 0, MAX_DELAY_MS))}
        return {"type": "create", "task": "synchronous/01", "clock": "lockstep",
                "labels": labels, "treatments": {ROBOT: delay}}  # fmt: skip

    def any(self) -> Any:
        """Return a message, or an unreadable frame."""
        kinds = (self.act, self.act, self.act, self.say, self.note, self.signal, self.unreadable)
        return self.chance.choice(kinds)()

    def act(self) -> dict[str, Any]:
        self.seq += self.chance.choice((0, 1, 1, 1))
        numbers = (None, 0, 1, FAR)
        return {
            "type": "act",
            "seq": max(1, self.seq),
            "action": self.action(),
            "reasoning": self.chance.choice((None, self.text(messages.Act, "reasoning"))),
            "basis": self.chance.choice(numbers),
            "max_age": self.chance.choice((*numbers, *[None] * 8)),
            "think_ms": self.chance.choice((0, 0, 86_400_000)),
            "anticipates": self.chance.random() < 0.3,
            "waits": self.chance.random() < 0.3,
        }

    def action(self) -> Any:
        name = self.chance.choice(
            ("move", "stack", "cook", self.text(messages.NamedAction, "name"))
        )
        things = ("table1", "table3", "stove1", "patty1", "bread1", "x" * 64)
        args = [ROBOT, *self.chance.choices(things, k=self.chance.choice((1, 2, 2, 3)))]
        named = {"name": name, "args": args}
        sentences = ("Move robot1 from table1 to table2", self.text(messages.Act, "action"))
        return self.chance.choice((None, 0, FAR, named, named, *sentences))

    def say(self) -> dict[str, Any]:
        return {"type": "say", "text": self.text(messages.Say, "text")}

    def note(self) -> dict[str, Any]:
        topic, text = self.text(messages.Note, "topic"), self.text(messages.Note, "text")
        return {"type": "note", "topic": topic, "text": text, "more": self.chance.random() < 0.5}

    def signal(self) -> dict[str, Any]:
        target = self.chance.choice((None, "stove1", self.text(messages.Signal, "target")))
        return {"type": "signal", "intent": self.chance.choice(("need", "wait")), "target": target}

    def unreadable(self) -> Any:
        return self.chance.choice((
            [], {"type": "🍔" * 300}, {"type": "act", "seq": -1, "x\n" * 200: "\x00" * 300},
            {"type": "say", "text": "x" * 60_000}, {"type": "act"}, "x" * 60_000, 10**15, None,
        ))  # fmt: skip


async def sent(connection: Raw, client: Client, count: int) -> None:
    """Send messages as fast as the rate of messages allows."""
    for _ in range(count):
        await connection.send(client.any())
        # A message of 32 KiB counts as many, and a wrong one as ten.
        await asyncio.sleep(0.5)


def check(path: Path) -> Recording:
    """Read and verify a recording."""
    recording = read_recording(path)
    verification = recording.verify()
    assert verification.ok, verification
    return recording


@pytest.mark.parametrize("seed", quick_sample(range(30)))
@virtual
async def test_recording_of_messages_at_their_limits_can_be_read(tmp_path: Path, seed: int) -> None:
    client = Client(seed)
    async with serving(tmp_path) as server:
        name, agent = client.text(messages.Hello, "name"), client.text(messages.Join, "agent")
        async with raw(server, text=seed % 2 == 0, hello=False) as ada:
            hello = {"type": "hello", "protocol": 1, "name": name}
            if (await ada.ask(hello, "welcome"))["type"] == "error":
                await ada.ask({**hello, "name": "ada"}, "welcome")
            created = await ada.ask(client.created(), "created")
            join = {"type": "join", "episode": created["code"], "agent": agent}
            # A name or a description of control characters is refused.
            if (await ada.ask(join, "joined"))["type"] == "error":
                await ada.ask({**join, "agent": ""}, "joined")
            await sent(ada, client, 60)
            await asyncio.sleep(MAX_DELAY_MS / 1000)
            (open_file,) = tmp_path.glob("*.rbt.part")
            totals = Recording(open_file.read_bytes()).totals
            written = server.lobby.find(created["code"]).journal
            assert isinstance(written, Journal)
            # Readers count whole states, too.
            assert replace(written.recorder.totals, frames=totals.frames) == totals
            assert totals.notes > 20
            await server.stop("over", hand_over=True)
        async with serving(tmp_path, seed=2) as again:
            again.lobby.find(created["code"]).abort("over")
    (closed,) = tmp_path.glob("*.rbt")
    assert check(closed).totals.notes > 20


@pytest.mark.slow
@virtual
async def test_longest_rejections_that_are_due_together_can_be_read(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server, text=False) as ada:
        treated = {"treatments": {ROBOT: {"delay_ms": MAX_DELAY_MS}}, "task": "synchronous/01"}
        created = await ada.ask({"type": "create", "clock": "lockstep", **treated}, "created")
        await ada.ask({"type": "join", "episode": created["code"]}, "joined")
        text, reasoning = longest(messages.Act, "action"), longest(messages.Act, "reasoning")
        for seq in range(1, 2 * MAX_HELD_REQUESTS):
            act = {"type": "act", "seq": seq, "action": "🍔" * text, "reasoning": "🍔" * reasoning}
            await ada.send(act)
            await asyncio.sleep(0.15)
        await asyncio.sleep(2 * MAX_DELAY_MS / 1000)
        server.lobby.find(created["code"]).abort("over")
    (closed,) = tmp_path.glob("*.rbt")
    assert check(closed).totals.reasons > MAX_HELD_REQUESTS // 2
