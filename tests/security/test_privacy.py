"""IP addresses are recorded only if the operator asks for it."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path

import pytest
from websockets.asyncio.client import connect

from robotouille.replay.compression import unwrap
from tests.support.processes import process
from tests.support.servers import Raw

pytestmark = pytest.mark.process

ADDRESS = "203.0.113.77"
FLAGS = (
    "--task", "synchronous/01", "--max-steps", "1", "--trust-proxy", "loopback",
    "--log-level", "debug", "--log-format", "json",
)  # fmt: skip


async def play(url: str, code: str) -> str:
    """Play an episode from another machine; return the id of the session."""
    headers = {"X-Forwarded-For": ADDRESS}
    async with connect(url, additional_headers=headers, compression=None, proxy=None) as socket:
        ada = Raw(socket, text=True)
        welcome = await ada.ask({"type": "hello", "protocol": 1, "name": "ada"}, "welcome")
        assert (await ada.ask({"type": "join", "episode": code}, "joined"))["type"] == "joined"
        await ada.ask({"type": "say", "text": "hello"}, "said")
        await ada.send({"type": "act", "seq": 1, "action": None})
        await ada.expect("ended")
        session: str = welcome["session"]
        return session


@pytest.mark.parametrize("flags", [(), ("--record-addresses",)])
def test_addresses_are_logged_only_if_enabled(tmp_path: Path, flags: tuple[str, ...]) -> None:
    with process(tmp_path / "r", *FLAGS, *flags) as (server, url, code):
        session = asyncio.run(play(url, code))
        server.send_signal(signal.SIGINT)
        _, log = server.communicate(timeout=30)
    rows = [json.loads(line) for line in log.splitlines()]
    assert rows[-1]["event"] == "stopped"
    received = [(row["event"], row["session"]) for row in rows if row.get("address") == ADDRESS]
    assert received == ([("participant connected", session)] if flags else [])
    assert log.count(ADDRESS) == len(received)
    (file,) = (tmp_path / "r").glob("*.rbt")
    plain = unwrap(file.read_bytes())
    assert session.encode() in plain
    assert ADDRESS.encode() not in plain
    others = [one for one in tmp_path.rglob("*") if one.is_file()]
    assert not [one for one in others if ADDRESS.encode() in one.read_bytes()]
