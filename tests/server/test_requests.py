"""Requests that cannot be done are answered with why not, and change nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run


def test_acting_outside_an_episode_is_rejected_under_its_number(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as client:
            answer = await client.ask({"type": "act", "seq": 4, "action": None}, "rejected")
            assert (answer["code"], answer["seq"]) == ("episode/none", 4)

    run(main())


async def two_players(server: Any, *clients: Raw, task: str = "multi_agent/01") -> str:
    created = await clients[0].ask({"type": "create", "task": task, "clock": "lockstep"}, "created")
    for number, client in enumerate(clients, 1):
        join = {"type": "join", "episode": created["code"], "seat": f"robot{number}"}
        await client.ask(join, "joined")
    for client in clients:
        while (await client.expect("roster"))["phase"] != "running":
            pass
    return str(created["code"])


def test_actions_that_cannot_be(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
            code = await two_players(server, ada, bob)
            answer = await bob.ask({"type": "join", "episode": code})
            assert answer["code"] == "episode/joined"
            table = {"name": "move", "args": ["robot2", "table1", "table2"]}
            for action, rejected_code, words in [
                (table, "action/invalid", "robot2 is not yours"),
                ({"name": "fly", "args": []}, "action/unknown", "no action 'fly'"),
                ({"name": "move", "args": []}, "action/unknown", "takes (p1: player"),
                ({"name": "move", "args": ["robot1", "tabel1", "x"]}, "action/unknown", "table1"),
                ({"name": "move", "args": ["robot1", "robot1", "x"]}, "action/unknown", "a player"),
                ("jump out of the window", "action/unknown", "no valid action"),
                (10_000, "action/unknown", "valid actions"),
            ]:
                answer = await ada.ask(
                    {"type": "act", "seq": 1, "action": action, "basis": 0}, "rejected"
                )
                assert answer.get("code", "action/invalid") == rejected_code, answer
                assert words in answer["reasons"][0], answer
                if rejected_code == "action/invalid":
                    break
            for seq, (action, words) in enumerate(
                [({"name": "fly", "args": []}, "no action"), (99, "valid actions")], 2
            ):
                answer = await ada.ask(
                    {"type": "act", "seq": seq, "action": action, "basis": 0}, "rejected"
                )
                assert words in answer["reasons"][0]
            answer = await ada.ask({"type": "act", "seq": 4, "action": 0, "basis": 7}, "rejected")
            assert answer["code"] == "action/stale"

    run(main())


def test_the_past_and_the_finished(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, max_steps=2) as server, raw(server) as ada, raw(server) as bob:
            code = await two_players(server, ada, bob)
            for seq in (5, 6):
                for client in (ada, bob):
                    await client.send({"type": "act", "seq": seq, "action": None})
                await ada.expect("delta")
                if seq == 5:
                    await ada.send({"type": "act", "seq": 3, "action": None})
                    answer = await ada.expect("rejected")
                    assert answer["code"] == "action/stale"
                    assert (await ada.expect("snapshot"))["step"] == 1
            assert (await ada.expect("ended"))["outcome"]["reason"] == "step_limit"
            await ada.send({"type": "act", "seq": 7, "action": None})
            assert (await ada.expect("rejected"))["code"] == "episode/over"
            async with raw(server) as late:
                answer = await late.ask({"type": "join", "episode": code})
                assert answer["code"] == "episode/over"

    run(main())


def test_full_episodes_seats_and_spectators(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, max_spectators=1, max_episodes=1) as server:
            async with (
                raw(server) as ada,
                raw(server) as bob,
                raw(server) as eve,
                raw(server) as dan,
            ):
                code = await two_players(server, ada, bob)
                for seat, expected in [(None, "episode/full"), ("robot1", "seat/taken"),
                                       ("robot9", "seat/unknown")]:  # fmt: skip
                    answer = await eve.ask({"type": "join", "episode": code, "seat": seat})
                    assert answer["code"] == expected
                watch = {"type": "join", "episode": code, "role": "spectator"}
                assert (await eve.ask(watch, "joined"))["role"] == "spectator"
                await eve.send({"type": "act", "seq": 1, "action": None})
                assert (await eve.expect("rejected"))["code"] == "seat/none"
                assert (await dan.ask(watch))["code"] == "episode/full"
                assert (await dan.ask({"type": "create"}))["code"] == "server/full"

    run(main())
