"""Whole games over the tools, in memory and in both eras of the protocol."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import Server
from tests.support.mcp_agent import agent, shortest_plan
from tests.support.servers import serving
from tests.support.virtual_time import opening, virtual

ALONE, TEAM = "synchronous/01", "multi_agent/01"


@pytest.mark.parametrize("mode", ["auto", "legacy"])
@virtual
async def test_agent_plays_a_task_to_its_goal(tmp_path: Path, mode: str) -> None:
    async with serving(tmp_path) as server, agent(server.url, mode=mode) as ada:
        code = await ada.opened(ALONE, clock="turn")
        await ada.call("join", episode=code, name="ada")
        for number, action in enumerate(shortest_plan(ALONE)):
            assert action in (await ada.call("list_actions"))["actions"]
            view = await ada.call("act", action=action, reasoning=f"thought {number}")
            assert view["action"]["status"] == "applied"
        assert view["outcome"] == {"reason": "goal", "steps": number + 1, "detail": ""}
        assert view["next"] == "The episode has ended. Call leave."
        assert "ended" in await ada.refused("act", action=action)
        assert await ada.call("leave") == {"episode": code}
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert recording.participants == {"robot1": ("ada", "model")}
    assert [m["reasoning"] for f in recording.steps for m in f["moves"]][0] == "thought 0"


@opening(serving)
async def test_two_agents_chat_and_take_turns(server: Server) -> None:
    async with agent(server.url) as ada, agent(server.url) as bob:
        code = await ada.opened(TEAM, clock="turn")
        view = await ada.call("join", episode=code, seat="robot1", name="ada")
        assert (view["phase"], view["your_move"]) == ("waiting", False)
        assert "free: robot2" in view["next"]
        assert "not begun" in await ada.refused("act", action="Do nothing")
        await bob.call("join", episode=code, seat="robot2", name="bob")
        view = await ada.call("wait")
        assert "The game has begun." in view["happened"]
        assert view["your_move"]
        await bob.call("observe")
        await bob.call("say", text="I take the lettuce")
        reported = (await ada.call("wait"))["chat"]
        assert reported == [
            {"name": "bob", "seat": "robot2", "text": "I take the lettuce", "own": False}
        ]
        first = view["actions"][0]
        done = await ada.call("act", action=first)
        assert done["action"]["status"] == "applied"
        assert "robot2's turn" in done["next"]
        seen = await bob.call("wait", until="my_move")
        assert f"Step 1: robot1: {first}" in seen["happened"]
        assert seen["observation"] and seen["your_move"]
        assert (await bob.call("wait", timeout_seconds=0))["observation"] is None
        assert (await bob.call("observe"))["observation"]


@opening(serving)
async def test_action_waiting_for_others_is_pending(server: Server) -> None:
    async with agent(server.url) as ada:
        code = await ada.opened(TEAM, clock="lockstep")
        async with connect(server.url, name="bob") as bob:
            view = await ada.call("join", episode=code, seat="robot1")
            game = await bob.join(code)
            await ada.call("wait")
            asked = await ada.call("act", action=view["actions"][0], timeout_seconds=3)
            assert asked["action"]["status"] == "pending"
            assert not asked["your_move"]
            assert "waits for robot2" in asked["next"]
            waiting = asyncio.create_task(ada.call("wait", until="my_move", timeout_seconds=60))
            await asyncio.sleep(1)
            assert (await game.act(None)).applied
            received = await waiting
            assert received["action"]["status"] == "applied"
            assert (await ada.call("observe"))["action"] is None


@opening(serving)
async def test_real_time_passes_while_an_agent_thinks(server: Server) -> None:
    async with agent(server.url) as ada:
        code = await ada.opened(ALONE, clock="realtime", step_rate=5)
        view = await ada.call("join", episode=code)
        await asyncio.sleep(4)
        late = await ada.call("wait", timeout_seconds=0)
        assert late["step"] > view["step"]
        await asyncio.sleep(4)
        stale = await ada.call("act", action=view["actions"][0], max_age=3)
        assert (stale["action"]["status"], stale["action"]["code"]) == ("rejected", "action/stale")
        assert stale["action"]["age"] > 3
        moved = await ada.call("act", action=view["actions"][0], max_age=3)
        assert (moved["action"]["status"], moved["action"]["age"] <= 3) == ("applied", True)
        assert (await ada.call("wait", until="my_move"))["your_move"]


@opening(serving)
async def test_busy_player_sees_the_kitchen_afterwards(server: Server) -> None:
    async with agent(server.url) as ada:
        async with connect(server.url, name="bob") as bob:
            code = (await bob.create(TEAM, clock="lockstep", timing="people")).code
            view = await ada.call("join", episode=code, seat="robot1")
            game = await bob.join(code)
            acting = asyncio.create_task(ada.call("act", action=view["actions"][0]))
            await game.act(None)
            moved = await acting
            assert "busy" in moved["next"]
            assert (moved["your_move"], moved["observation"]) == (False, None)
            waiting = asyncio.create_task(ada.call("wait", until="my_move"))
            while game.state.busy_steps("robot1"):
                await game.act(None)
            view = await waiting
            assert view["your_move"] and view["observation"]


@opening(serving)
async def test_one_agent_plays_all_seats(server: Server) -> None:
    async with agent(server.url) as ada:
        code = await ada.opened(TEAM, clock="lockstep")
        games = [(await ada.call("join", episode=code))["game"] for _ in range(2)]
        refusal = await ada.refused("observe")
        assert all(game in refusal for game in games)
        views = await asyncio.gather(
            *(ada.call("act", action="Do nothing", game=game) for game in games)
        )
        assert [view["seat"] for view in views] == ["robot1", "robot2"]
        assert [view["step"] for view in views] == [1, 1]


@opening(serving)
async def test_spectator_cannot_act(server: Server) -> None:
    async with agent(server.url) as eve:
        code = await eve.opened(TEAM)
        view = await eve.call("join", episode=code, role="spectator")
        assert (view["seat"], view["actions"]) == ("", [])
        refusal = await eve.refused("act", action="Do nothing")
        assert "seat/none" in refusal and "join as player" in refusal
