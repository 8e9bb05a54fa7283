"""Archive: participants who come back after the end see it, and no other episode is delayed."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import AsyncIterator, Generator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from robotouille.replay.container import MAX_FILE
from robotouille.replay.recording import Recording
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from robotouille_server.auth.tokens import ResumeGrant
from robotouille_server.rooms.recording import archive
from robotouille_server.rooms.recording.archive import MAX_SOUGHT
from robotouille_server.rooms.recording.folder_lister import LIST_SECONDS
from robotouille_server.rooms.recording.recovery import RETRY_SECONDS
from robotouille_server.rooms.recording.storage import Folder
from robotouille_server.runtime.work_in_turns import FRAMES_A_TURN
from tests.support.servers import crash, raw, serving
from tests.support.virtual_time import virtual

HELLO = {"type": "hello", "protocol": 1, "name": "bob"}


class CountingFolder(Folder):
    """Folder that records its reads, and whether they happen on the event loop."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.listed: list[bool] = []
        self.read_files: list[str] = []

    def names(self) -> list[str]:
        self.listed.append(threading.current_thread() is threading.main_thread())
        return super().names()

    def read(self, name: str) -> bytes:
        self.read_files.append(name)
        return super().read(name)


def token_for(server: Server, episode: str) -> str:
    """Return a resume token for a session in an episode that the server does not know."""
    grant = ResumeGrant(
        session=f"session of {episode}",
        generation=1,
        name="eve",
        kind="human",
        role=Role.PLAYER,
        episode=episode,
        seat="robot1",
    )
    return server.tokens.mint_resume(grant, 3600)


@asynccontextmanager
async def after_the_end(
    folder: Path, steps: int = 60, **options: Any
) -> AsyncIterator[tuple[Server, str]]:
    """Run a second server after an episode has ended on a first one; yield a token for the
    episode.
    """
    async with serving(folder) as first:
        async with raw(first) as ada:
            request = {"type": "create", "task": "synchronous/01", "max_steps": steps}
            created = await ada.ask({**request, "clock": "realtime", "step_rate": 50}, "created")
            joined = await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            await ada.expect("ended")
        await first.lobby.closed()
        await crash(first)
    async with serving(folder, seed=2, **options) as second:
        assert not second.lobby.rooms
        yield second, joined["resume"]


@virtual
async def test_other_episodes_run_during_a_search(tmp_path: Path) -> None:
    async with after_the_end(tmp_path, steps=400) as (server, _):
        turns = 0

        async def count() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        other = asyncio.create_task(count())
        await server.lobby.show_end(next(iter(server.lobby._recovery._lister.closed)))  # type: ignore[union-attr]
        other.cancel()
        assert turns > 2 * 400 / FRAMES_A_TURN
        assert len(server.lobby.rooms) == 1


@virtual
async def test_messages_during_a_search_are_answered_after_welcome(tmp_path: Path) -> None:
    async with after_the_end(tmp_path) as (server, token):
        async with raw(server, hello=False) as bob:
            await bob.send({**HELLO, "resume": token})
            for ref in (1, 2, 3):
                await bob.send({"type": "list", "ref": ref})
            welcome = await bob.receive()
            assert (welcome["type"], welcome["resumed"]) == ("welcome", True)
            reported = [await bob.receive() for _ in range(6)]
            assert [m["ref"] for m in reported if m["type"] == "episodes"] == [1, 2, 3]
            (snapshot,) = [m for m in reported if m["type"] == "snapshot"]
            assert (snapshot["step"], snapshot["outcome"]["reason"]) == (60, "step_limit")


@pytest.mark.parametrize(("limit", "value"), [("MAX_STEPS", 59), ("MAX_BYTES", 10_000)])
@virtual
async def test_too_long_recording_is_refused_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int
) -> None:
    monkeypatch.setattr(archive, limit, value)
    async with after_the_end(tmp_path) as (server, token):
        async with raw(server, hello=False) as bob:
            refused = await bob.ask({**HELLO, "resume": token}, "welcome")
            assert refused["code"] == "auth/expired"
            assert "the episode has ended" in refused["message"]
            again = await bob.ask(HELLO, "welcome")
            assert again["type"] == "welcome", again
        assert not server.lobby.rooms


@virtual
async def test_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    async with after_the_end(tmp_path) as (server, token):
        (file,) = tmp_path.glob("*.rbt")
        os.truncate(file, MAX_FILE + 1)
        with capture_logs() as logs:
            async with raw(server, hello=False) as bob:
                refused = await bob.ask({**HELLO, "resume": token}, "welcome")
        assert refused["code"] == "auth/expired"
        assert [log["error"] for log in logs if log["event"] == "recording not read"] == [
            "larger than 256 MiB, the maximum size"
        ]


@virtual
async def test_client_that_disconnects_during_a_search_is_harmless(tmp_path: Path) -> None:
    async with after_the_end(tmp_path, steps=100) as (server, token):
        async with raw(server, hello=False) as bob:
            await bob.send({**HELLO, "resume": token})
            while not server.lobby._recovery.archive._sought:  # type: ignore[union-attr]
                await asyncio.sleep(0)
            bob.socket.transport.abort()
        async with raw(server, hello=False) as again:
            welcome = await again.ask({**HELLO, "resume": token}, "welcome")
            assert welcome["resumed"] is True
        assert len(server.lobby.rooms) == 1


@virtual
async def test_server_can_stop_during_a_search(tmp_path: Path) -> None:
    async with after_the_end(tmp_path, steps=100) as (server, token):
        async with raw(server, hello=False) as bob:
            await bob.send({**HELLO, "resume": token})
            while not server.lobby._recovery.archive._sought:  # type: ignore[union-attr]
                await asyncio.sleep(0)
            await server.stop()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        assert not [task for task in tasks if "_handle_hello_later" in repr(task)]


@virtual
async def test_copy_of_a_recording_is_ignored(tmp_path: Path) -> None:
    async with after_the_end(tmp_path) as (server, token):
        (whole,) = tmp_path.glob("*.rbt")
        (tmp_path / f"a_copy_{whole.name}").write_bytes(whole.read_bytes())
        whole.unlink()
        async with raw(server, hello=False) as bob:
            refused = await bob.ask({**HELLO, "resume": token}, "welcome")
            assert refused["code"] == "auth/expired"


@virtual
async def test_long_search_does_not_count_as_silence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    show = archive.Archive._show

    async def slowly(self: archive.Archive, episode: str) -> None:
        await asyncio.sleep(25)
        await show(self, episode)

    monkeypatch.setattr(archive.Archive, "_show", slowly)
    async with after_the_end(tmp_path) as (server, token):
        async with raw(server, hello=False) as bob:
            answer = await bob.ask({**HELLO, "resume": token}, "welcome", "bye")
            assert (answer["type"], answer["resumed"]) == ("welcome", True)
        async with raw(server, hello=False) as bob:
            await bob.send({**HELLO, "resume": token})
            await asyncio.sleep(12)
        await asyncio.sleep(1)
        waiting = [t for t in asyncio.all_tasks() if "_handle_hello_later" in str(t.get_coro())]
        assert not waiting, "who has gone is still being looked for"


@pytest.mark.slow
@virtual
async def test_folder_is_listed_rarely_and_in_a_thread(
    tmp_path: Path,
) -> None:
    """Anybody can send resume tokens of unknown episodes, so they must be cheap."""
    folder = CountingFolder(tmp_path)
    async with serving(tmp_path, storage=folder) as server:
        folder.listed.clear()
        begin = asyncio.get_running_loop().time()
        for number in range(6):
            for _ in range(20):
                token = token_for(server, f"{number:016x}")
                async with raw(server, hello=False) as eve:
                    refused = await eve.ask({**HELLO, "resume": token}, "welcome")
                assert refused["code"] == "auth/expired"
                await asyncio.sleep(0.05)
        took = asyncio.get_running_loop().time() - begin
        assert 1 <= len(folder.listed) <= 1 + took / LIST_SECONDS
        assert not any(folder.listed), "the games waited for the disk"


@virtual
async def test_wrong_codes_list_no_folder_while_another_process_has_an_episode(
    tmp_path: Path,
) -> None:
    folder = CountingFolder(tmp_path)
    wrong = {"type": "join", "episode": "AAAAA-AAAAA"}
    async with serving(tmp_path) as first, raw(first) as ada:
        await ada.ask({"type": "create", "task": "synchronous/01"}, "created")
        async with serving(tmp_path, seed=2, storage=folder) as second, raw(second) as eve:
            folder.listed.clear()
            begin = asyncio.get_running_loop().time()
            for _ in range(20):
                assert (await eve.ask(wrong))["code"] == "episode/unknown"
                await asyncio.sleep(0.5)
            took = asyncio.get_running_loop().time() - begin
            assert len(folder.listed) <= 1 + took / LIST_SECONDS
            assert not any(folder.listed), "the games waited for the disk"


@virtual
async def test_episodes_that_another_process_opens_later_are_taken_over_too(
    tmp_path: Path,
) -> None:
    create = {"type": "create", "task": "synchronous/01"}
    async with serving(tmp_path) as first, raw(first) as ada:
        codes = {(await ada.ask(create, "created"))["code"]}
        async with serving(tmp_path, seed=2) as second:
            codes.add((await ada.ask(create, "created"))["code"])
            await asyncio.sleep(2 * LIST_SECONDS)
            assert not second.lobby.rooms
            await crash(first)
            await asyncio.sleep(RETRY_SECONDS)
            assert {room.code for room in second.lobby.rooms.values()} == codes


@virtual
async def test_recording_closed_by_another_process_is_found_later(
    tmp_path: Path,
) -> None:
    async with after_the_end(tmp_path) as (server, token):
        (closed,) = tmp_path.glob("*.rbt")
        hidden = closed.rename(tmp_path / "elsewhere")
        server.lobby.recover()
        async with raw(server, hello=False) as eve, raw(server, hello=False) as bob:
            unknown = token_for(server, "0" * 16)
            refused = await eve.ask({**HELLO, "resume": unknown}, "welcome")
            assert refused["code"] == "auth/expired"
            hidden.rename(closed)
            welcome = await bob.ask({**HELLO, "resume": token}, "welcome")
            assert welcome.get("resumed") is True, welcome


@virtual
async def test_number_of_concurrent_searches_is_limited(tmp_path: Path) -> None:
    async with after_the_end(tmp_path) as (server, token):
        seeking = server.lobby._recovery.archive  # type: ignore[union-attr]
        await server.lobby.show_end("the next listing is some seconds away")
        asked = [
            asyncio.create_task(server.lobby.show_end(f"{number}"))
            for number in range(MAX_SOUGHT + 10)
        ]
        await asyncio.sleep(0)
        assert len(seeking._sought) == MAX_SOUGHT
        async with raw(server, hello=False) as bob:
            refused = await bob.ask({**HELLO, "resume": token}, "welcome")
            assert refused["code"] == "auth/expired"
            assert "too many" in refused["message"]
            assert (await bob.ask(HELLO, "welcome"))["type"] == "welcome"
        await asyncio.sleep(2 * LIST_SECONDS)
        async with raw(server, hello=False) as bob:
            assert (await bob.ask({**HELLO, "resume": token}, "welcome"))["resumed"]
        assert len(seeking._missed) <= MAX_SOUGHT
        refusals = [one for one in await asyncio.gather(*asked, return_exceptions=True) if one]
        assert len(refusals) == 10


@virtual
async def test_strict_server_does_not_search_for_anonymous_sessions(tmp_path: Path) -> None:
    folder = CountingFolder(tmp_path)
    async with after_the_end(tmp_path, storage=folder, require_token=True) as (server, token):
        folder.listed.clear()
        folder.read_files.clear()
        async with raw(server, hello=False) as bob:
            for resume in (token, token_for(server, "0" * 16)):
                refused = await bob.ask({**HELLO, "resume": resume}, "welcome")
                assert refused["code"] == "auth/required"
        assert (folder.listed, folder.read_files) == ([], [])


@pytest.mark.slow
@virtual
async def test_too_long_recording_is_read_only_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "MAX_STEPS", 50)
    folder = CountingFolder(tmp_path)
    turns: list[int] = []
    opening = Recording.opening

    def counted(*args: Any, **options: Any) -> Generator[int, None, Recording]:
        for step in (reading := opening(*args, **options)):
            turns.append(step)
            yield step
        raise AssertionError(f"{reading} was read to its end")

    async with after_the_end(tmp_path, steps=400, storage=folder) as (server, token):
        monkeypatch.setattr(Recording, "opening", counted)
        folder.read_files.clear()
        async with raw(server, hello=False) as bob:
            received = [await bob.ask({**HELLO, "resume": token}, "welcome") for _ in range(5)]
        assert {answer["code"] for answer in received} == {"auth/expired"}
        assert all("more than 50 steps" in answer["message"] for answer in received)
        assert turns[-1] == 51
        assert len(folder.read_files) == 1


@virtual
async def test_damaged_recording_is_read_only_once(tmp_path: Path) -> None:
    folder = CountingFolder(tmp_path)
    async with after_the_end(tmp_path, storage=folder) as (server, token):
        (closed,) = tmp_path.glob("*.rbt")
        closed.write_bytes(closed.read_bytes()[:-5])
        folder.read_files.clear()
        async with raw(server, hello=False) as bob:
            for _ in range(3):
                refused = await bob.ask({**HELLO, "resume": token}, "welcome")
                assert refused["code"] == "auth/expired"
        assert len(folder.read_files) == 1
