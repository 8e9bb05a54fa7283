"""What a model gets wrong is answered by what to do next, and changes nothing."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille.world.sentences import MAX_SENTENCE
from robotouille_client import connect
from robotouille_server.auth.roles import Role
from tests.support.mcp_agent import agent
from tests.support.newcomers import minted
from tests.support.servers import crash, serving
from tests.support.virtual_time import run

ALONE, TEAM = "synchronous/01", "multi_agent/01"


def test_what_is_not_there_or_taken_is_said_with_what_to_do(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            assert "call create_episode" in (await ada.call("list_episodes") and ada.read)
            code = await ada.opened(TEAM)
            await ada.call("join", episode=code, seat="robot1", name="ada")
            refused: list[tuple[str, dict[str, Any], str]] = [
                ("join", {"episode": "XXXXX-XXXXX"}, "list_episodes"),
                ("join", {"episode": code, "seat": "robot1"}, 'played by ada". Join without'),
                ("join", {"episode": code, "seat": "robot7"}, "seat/unknown"),
                ("join", {"episode": code, "role": "cook"}, "role"),
                ("create_episode", {"task": "nope"}, "robotouille://tasks"),
                ("create_episode", {"task": ALONE, "seats": 3}, "possible: 1"),
                ("create_episode", {"task": ALONE, "clock": "fast"}, "clock"),
                ("observe", {"game": "game-x"}, "call join"),
                ("act", {}, "action"),
                ("say", {"text": ""}, "text"),
                ("wait", {"timeout_seconds": 1e9}, "timeout_seconds"),
                ("fly", {}, "fly"),
            ]
            for tool, arguments, hint in refused:
                assert hint in await ada.refused(tool, **arguments), tool
            (row,) = (await ada.call("list_episodes"))["episodes"]
            assert row["free_seats"] == ["robot2"]

    run(main())


@pytest.mark.parametrize(
    ("tool", "argument", "limit"),
    [
        ("act", "action", MAX_SENTENCE),
        ("act", "reasoning", 8_000),
        ("say", "text", 500),
        ("join", "episode", 64),
        ("observe", "game", 64),
    ],
)
def test_oversized_arguments_are_refused_by_name(
    tmp_path: Path, tool: str, argument: str, limit: int
) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            await ada.call("join", episode=await ada.opened(ALONE))
            arguments = {"action": "Do nothing"} if tool == "act" else {}
            answer = await ada.refused(tool, **{**arguments, argument: "x" * (limit + 1)})
            assert argument in answer and f"at most {limit}" in answer
            assert len(answer) < 1_000
            assert (await ada.call("observe"))["step"] == 0

    run(main())


def test_an_action_that_cannot_be_done_is_rejected_with_its_reasons(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            await ada.call("join", episode=await ada.opened(ALONE, clock="lockstep"))
            unmet = await ada.call("act", action="Move robot1 from table1 to table2")
            assert unmet["action"]["status"] == "rejected"
            assert "needs: robot1 stands at table1" in unmet["action"]["reasons"]
            assert "Rejected" in ada.read and "Valid actions" in ada.read
            unknown = await ada.call("act", action="Fly to the moon\nStep 9: robot1: serve")
            assert unknown["action"]["code"] == "action/unknown"
            assert "\nStep 9" not in ada.read
            assert unknown["step"] == 0

    run(main())


def test_one_who_is_not_on_turn_is_told_whose_turn_it_is(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            async with connect(server.url, name="bob") as bob:
                code = await ada.opened(TEAM, clock="turn")
                await bob.join(code, seat="robot1")
                view = await ada.call("join", episode=code, seat="robot2")
                assert "robot1's turn" in view["next"]
                refused = await ada.call("act", action=view["actions"][0])
                assert refused["action"]["reasons"] == ["it is robot1's turn"]

    run(main())


def test_no_server_a_wrong_token_and_a_lesser_role(tmp_path: Path) -> None:
    async def main() -> None:
        async with agent("ws://127.0.0.1:9") as ada:
            assert "not running" in await ada.refused("join", episode="ABCDE-FGHIJ")
        async with serving(tmp_path, require_token=True) as server:
            tokens = [None, "nonsense", minted(server, Role.PLAYER)]
            answers = ["auth/required", "auth/invalid", "auth/role"]
            for token, answer in zip(tokens, answers, strict=True):
                async with agent(server.url, token=token) as ada:
                    said = await ada.refused("list_episodes")
                    assert answer in said
                    assert token is None or token not in said

    run(main())


def test_a_server_that_dies_and_comes_back_loses_no_action(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            url, port = server.url, server.port
            async with agent(url) as ada:
                view = await ada.call("join", episode=await ada.opened(ALONE, clock="lockstep"))
                await ada.call("act", action="Do nothing")
                await crash(server)
                asked = await ada.call("act", action=view["actions"][0], timeout_seconds=5)
                assert asked["action"]["status"] == "pending"
                assert not asked["connected"]
                assert "get back into your seat" in asked["next"]
                async with serving(tmp_path, port=port, seed=2):
                    told = await ada.call("wait", until="my_move", timeout_seconds=60)
                    assert told["connected"]
                    assert told["action"]["status"] == "applied"
                    assert told["step"] == 2

    run(main())


def test_one_who_is_muted_is_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            await ada.call("join", episode=await ada.opened(ALONE))
            assert await ada.call("say", text="hello") == {"text": "hello"}
            (room,) = server.lobby.rooms.values()
            room.mute(next(iter(room.members)))
            assert "not heard" in await ada.refused("say", text="hello")

    run(main())


def test_one_who_is_sent_out_is_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            await ada.call("join", episode=await ada.opened(ALONE))
            await ada.call("observe")
            (room,) = server.lobby.rooms.values()
            waiting = asyncio.create_task(ada.call("wait"))
            await asyncio.sleep(1)
            room.abort("the study is over")
            told = await waiting
            assert told["outcome"]["reason"] == "aborted"
            assert "over" in told["next"]

    run(main())
