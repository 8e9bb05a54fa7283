"""A server that cannot start, or fails, takes no game with it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import ServerSettings, serve
from robotouille_server.app import CannotListenError
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import run


async def left_behind(folder: Path) -> None:
    """An episode whose server was killed."""
    async with serving(folder) as server, connect(server.url, name="ada") as ada:
        game = await ada.join((await ada.create("synchronous/01")).code)
        await game.act(game.actions[0])
        await crash(server)


def still_open(folder: Path) -> bool:
    (file,) = folder.iterdir()
    return file.name.endswith(".rbt.part") and read_recording(file).outcome is None


def test_a_port_in_use_ends_no_episode(tmp_path: Path) -> None:
    async def main() -> None:
        await left_behind(tmp_path / "a")
        async with serving(tmp_path / "b") as other:
            settings = ServerSettings(port=other.port, recordings=tmp_path / "a")
            with pytest.raises(CannotListenError):
                async with serve(settings):
                    pass

    run(main())
    assert still_open(tmp_path / "a")


def test_nor_does_a_failure(tmp_path: Path) -> None:
    async def main() -> None:
        await left_behind(tmp_path)
        with pytest.raises(ZeroDivisionError):
            async with serving(tmp_path, seed=2) as server:
                assert len(server.lobby.rooms) == 1
                raise ZeroDivisionError

    run(main())
    assert still_open(tmp_path)


def test_a_message_in_the_last_moment_is_not_answered_from_an_empty_lobby(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, hello=False) as late:
            async with raw(server) as ada:
                created = await ada.ask({"type": "create", "task": "synchronous/01"}, "created")
                joined = await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            hello = {"type": "hello", "protocol": 1, "name": "ada", "resume": joined["resume"]}
            await late.send(hello)
            stopping = asyncio.create_task(server.stop("restart", hand_over=True))
            answer = await late.receive()
            await stopping
            if answer["type"] == "welcome":
                answer = await late.expect("bye")
            assert (answer["type"], answer["code"], answer["retry"]) == (
                "bye",
                "server/restart",
                True,
            )

    run(main())
