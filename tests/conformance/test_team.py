"""An agent of the Model Context Protocol and a JSON bot in another language cook together."""

from __future__ import annotations

import asyncio
import importlib.util
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from tests.conformance.node import run_node
from tests.conformance.plans import played_plan
from tests.support.server_process import ServerProcess

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(not importlib.util.find_spec("mcp"), reason="needs the extra mcp"),
]

TASK = "multi_agent/09_two_lettuce_cheeseburgers@2"
"""Its plan can be played in seat order, each action valid when it is sent."""


def test_they_reach_the_goal_and_the_recording_says_who_did_what(server: ServerProcess) -> None:
    _, orders, _ = played_plan(TASK)
    plans = [[dict(step)[seat] for step in orders] for seat in range(2)]
    view, partner = asyncio.run(together(server.url, *plans))
    assert view["outcome"]["reason"] == partner["outcome"]["reason"] == "goal"
    assert partner["seat"] == "robot2"
    (file,) = server.recordings.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert recording.participants == {"robot1": ("ada", "model"), "robot2": ("js", "bot")}


async def together(
    url: str, mine: list[dict[str, Any] | None], theirs: list[dict[str, Any] | None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    from tests.support.mcp_agent import agent

    async with agent(url) as ada:
        code = await ada.opened(TASK, clock="lockstep")
        await ada.call("join", episode=code, seat="robot1", name="ada")
        options = {"url": url, "code": code, "name": "js", "actions": theirs}
        partner = asyncio.create_task(asyncio.to_thread(run_node, "partner", **options))
        view = await ada.call("wait", timeout_seconds=60)
        for action in mine:
            asked = "Do nothing" if action is None else sentence(action)
            view = await ada.call("act", action=asked)
            assert view["action"]["status"] == "applied", ada.read
        return view, await partner


def sentence(action: dict[str, Any]) -> str:
    return f"{action['name']}({', '.join(action['args'])})"
