"""Nobody in an episode has another's name, or one that hides something."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from robotouille import World
from robotouille.episode import Episode, Rules
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.seats.display_names import DisplayNames
from tests.support.servers import Raw, crash, raw, serving
from tests.support.virtual_time import run

TASK = "multi_agent/01"


async def enter(client: Raw, code: str, **request: Any) -> dict[str, Any]:
    joined = await client.ask({"type": "join", "episode": code, **request}, "joined")
    assert joined["type"] == "joined", joined
    return joined


async def opened(client: Raw) -> str:
    return str((await client.ask({"type": "create", "task": TASK}, "created"))["code"])


def seated(server: Server, code: str) -> list[str]:
    return [seat.name for seat in server.lobby.find(code).episode.seats.values()]


async def hello(client: Raw, name: str, **fields: Any) -> dict[str, Any]:
    return await client.ask({"type": "hello", "protocol": 1, "name": name, **fields}, "welcome")


def test_the_later_of_two_gets_a_number_and_is_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            raw(server, name="ada") as one,
            raw(server, name="\u202eADA\u200b") as two,
            raw(server, name="ａｄａ") as three,
        ):
            code = await opened(one)
            assert (await enter(one, code))["name"] == "ada"
            assert (await enter(two, code))["name"] == "ADA 2"
            assert (await enter(three, code, role="spectator"))["name"] == "ada 3"
            assert seated(server, code) == ["ada", "ADA 2"]
            await two.send({"type": "say", "text": "hi"})
            assert (await three.expect("said"))["name"] == "ADA 2"
            await three.send({"type": "say", "text": "hi"})
            while "seat" in (said := await one.expect("said")):
                pass
            assert said["name"] == "ada 3"

    run(main())


def test_a_name_is_free_again_and_elsewhere_one_has_ones_own(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            raw(server, name="ada") as one,
            raw(server, name="ada") as two,
        ):
            code = await opened(one)
            await enter(one, code, role="spectator")
            assert (await enter(two, code, role="spectator"))["name"] == "ada 2"
            await two.ask({"type": "leave"}, "left")
            assert (await enter(two, await opened(two)))["name"] == "ada"
            await two.ask({"type": "leave"}, "left")
            await one.ask({"type": "leave"}, "left")
            assert (await enter(two, code))["name"] == "ada"
            assert (await enter(one, code))["name"] == "ada 2"

    run(main())


def test_a_refused_join_takes_no_name(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            raw(server, name="ada") as one,
            raw(server, name="ada") as two,
        ):
            code = await opened(one)
            await enter(one, code)
            refused = await two.ask({"type": "join", "episode": code, "seat": "robot1"}, "joined")
            assert refused["code"] == "seat/taken"
            for _ in range(2):
                assert (await enter(two, code))["name"] == "ada 2"
                await two.ask({"type": "leave"}, "left")

    run(main())


def test_whoever_comes_back_keeps_the_name_also_after_a_restart(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path) as server,
            raw(server, name="ada") as one,
            raw(server, name="ada") as two,
        ):
            code = await opened(one)
            await enter(one, code)
            token = (await enter(two, code))["resume"]
            await two.socket.close()
            await asyncio.sleep(0.1)
            async with raw(server, hello=False) as again:
                await hello(again, "ada", resume=token)
                joined = await again.expect("joined")
                assert joined["name"] == "ada 2"
            await crash(server)
        async with serving(tmp_path, seed=2) as server:
            async with raw(server, hello=False) as again, raw(server, name="Ada") as third:
                await hello(again, "somebody else", resume=joined["resume"])
                assert (await again.expect("joined"))["name"] == "ada 2"
                assert seated(server, code) == ["ada", "ada 2"]
                assert (await enter(third, code, role="spectator"))["name"] == "Ada 3"
                await again.ask({"type": "leave"}, "left")
                assert (await enter(again, await opened(again)))["name"] == "ada"

    run(main())


def test_a_tokens_name_is_binding_but_for_the_number(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, name="host") as host:
            code = await opened(host)
            names = []
            for said in ("robin", "\u202e"):
                token = server.tokens.mint_role(
                    Role.PLAYER, "p-1", seconds=60, name="Robin\x1b\u202e"
                )
                async with raw(server, hello=False) as client:
                    assert (await hello(client, said, token=token))["type"] == "welcome"
                    names.append((await enter(client, code))["name"])
            assert names == ["Robin", "Robin 2"]

    run(main())


def test_a_name_of_which_nothing_can_be_seen_is_refused(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, hello=False) as client:
            answer = await hello(client, "\u200b \u202e\u3164")
            assert (answer["code"], answer["field"]) == ("message/invalid-field", "name")
            assert answer["message"] == "nothing of this name can be seen"
            assert (await hello(client, "ada"))["type"] == "welcome"

    run(main())


def test_thousands_of_the_same_name_are_told_apart_in_little_time() -> None:
    names, asked = DisplayNames(Episode(World("multi_agent/01"), Rules(), 0.0)), []
    for _ in range(5000):
        name = names.choose("eve")
        names.watch(name)
        asked.append(name)
    assert len(set(asked)) == 5000
