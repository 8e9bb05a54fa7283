"""Full disk: what participants see while a recording cannot be written, and what must not grow."""

from __future__ import annotations

import asyncio
import errno
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_server import Server
from robotouille_server.cli import first_room
from robotouille_server.rooms.recording import write_ahead
from robotouille_server.rooms.recording.storage import Folder
from robotouille_server.rooms.room import Room
from robotouille_server.transport.peer import MAX_UNSENT, Peer
from tests.support.disks import FullDisk, NearlyFull
from tests.support.servers import Raw, raw, serving, with_clients
from tests.support.virtual_time import virtual

MIB = 1024 * 1024
HELLO = {"type": "hello", "protocol": 1, "name": "ada"}


async def seated(ada: Raw, bob: Raw, **options: object) -> dict[str, Any]:
    """Let Ada and Bob join an episode; return Ada's `joined`."""
    request = {"type": "create", "task": "multi_agent/02", **options}
    join = {"type": "join", "episode": (await ada.ask(request, "created"))["code"]}
    joined = await ada.ask(join, "joined")
    assert (await bob.ask(join, "joined"))["type"] == "joined"
    return joined


@virtual
async def test_nearly_full_disk_is_left_to_running_episodes(tmp_path: Path) -> None:
    disk = NearlyFull(tmp_path)
    async with serving(tmp_path, storage=disk, min_free_space=100) as server:
        async with raw(server) as ada, raw(server) as bob, raw(server) as eve:
            joined = await seated(ada, bob, max_steps=3)
            disk.free = 100 * MIB - 1
            refused = await eve.ask({"type": "create"})
            assert refused["code"] == "server/full"
            assert "disk for recordings is nearly full" in refused["message"]
            for number in range(3):
                for player in (ada, bob):
                    await player.send({"type": "act", "seq": number + 1, "action": None})
            assert (await ada.expect("ended"))["outcome"]["reason"] == "step_limit"
            again = {"type": "create", "rematch": joined["code"]}
            assert (await ada.ask(again))["code"] == "server/full"
            disk.free = 100 * MIB
            assert (await ada.ask(again, "created"))["type"] == "created"


@virtual
async def test_server_with_a_nearly_full_disk_starts(tmp_path: Path) -> None:
    disk = NearlyFull(tmp_path)
    disk.free = 0
    async with serving(tmp_path, storage=disk) as server:
        assert first_room(server) is None
    async with serving(tmp_path, storage=disk, min_free_space=0) as server:
        assert first_room(server) is not None


class Unclosable(Folder):
    """Folder in which no recording can get its final name."""

    def replace(self, name: str, content: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


@virtual
async def test_end_is_shown_although_the_recording_was_not_closed(tmp_path: Path) -> None:
    async with serving(tmp_path, storage=Unclosable(tmp_path)) as server:
        async with raw(server) as ada, raw(server) as bob:
            joined = await seated(ada, bob)
        room = server.lobby.find(joined["code"])
        room.abort("the study is over")
        while not room.problem:  # A thread closes the file; no virtual time passes.
            await asyncio.sleep(0)
        assert "cannot be closed" in room.problem
        async with raw(server, hello=False) as again, asyncio.timeout(30):
            welcome = await again.ask({**HELLO, "resume": joined["resume"]}, "welcome")
            assert welcome["resumed"] is True
            assert (await again.expect("joined"))["episode"] == joined["episode"]
            assert (await again.expect("snapshot"))["outcome"]["reason"] == "aborted"


@virtual
async def test_unopened_episodes_leave_no_file_open(tmp_path: Path) -> None:
    disk = FullDisk(tmp_path)
    disk.full = True
    async with serving(tmp_path, storage=disk) as server, raw(server) as ada:
        before = len(list(Path("/dev/fd").iterdir()))
        for _ in range(20):
            answer = await ada.ask({"type": "create"}, "created")
            assert answer["code"] == "server/recording"
            await asyncio.sleep(1)
        assert len(list(Path("/dev/fd").iterdir())) == before
        assert not list(tmp_path.iterdir())
        disk.full = False
        assert (await ada.ask({"type": "create"}, "created"))["code"]


@virtual
async def test_slow_client_gets_no_snapshot_before_the_state_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = FullDisk(tmp_path)
    async with with_clients(tmp_path, "ada", "bob", storage=disk) as (server, ada, bob):
        created = await ada.create("multi_agent/02", clock="realtime")
        one, two = await ada.join(created.code), await bob.join(created.code)
        room = server.lobby.find(created.code)
        slow = next(session.peer for session in room.members if session.name == "ada")
        slows_down = True
        genuine = vars(Peer)["unsent"]

        def unsent(peer: Peer) -> int:
            size: int = genuine.fget(peer)
            return MAX_UNSENT + 1 if peer is slow and slows_down else size

        while one.step < 2:
            await asyncio.sleep(0.05)
        monkeypatch.setattr(Peer, "unsent", property(unsent))
        while two.step < 5:
            await asyncio.sleep(0.05)
        assert one.step < two.step
        disk.full = True
        while not room.problem:
            await asyncio.sleep(0.05)
        (file,) = tmp_path.glob("*.part")
        written = read_recording(file).steps[-1]["step"]
        assert written < room.episode.step
        slows_down = False
        await asyncio.sleep(2)
        assert one.step <= written
        disk.full = False
        await asyncio.sleep(2)
        assert one.step > written
        assert one.state == two.state


@pytest.mark.parametrize("kind", ["say", "act"])
@virtual
async def test_messages_during_a_full_disk_do_not_accumulate(tmp_path: Path, kind: str) -> None:
    """A disk may be full for hours."""
    impossible = {"name": "move", "args": ["robot1", "table1", "table1"]}
    disk = FullDisk(tmp_path)
    async with serving(tmp_path, storage=disk) as server:
        async with raw(server, name="ada") as ada, raw(server, name="bob") as bob:
            joined = await seated(ada, bob)
            room = server.lobby.find(joined["code"])
            assert room.journal is not None
            disk.full = True
            await bob.send({"type": "say", "text": "does anybody hear me?"})
            while not room.problem:
                await asyncio.sleep(0.1)
            size = room.journal.size
            for seq in range(1, 501):
                if kind == "say":
                    async with asyncio.timeout(10):
                        refused = await ada.ask({"type": "say", "text": "x" * 500})
                    assert refused["code"] == "server/recording"
                else:
                    await ada.send({"type": "act", "seq": seq, "action": impossible})
                if seq % 20 == 0:
                    await asyncio.sleep(1)
            assert room.problem
            disk.full = False
            await asyncio.sleep(3)
            assert not room.problem
            assert 0 < room.journal.size - size < 2000


@virtual
async def test_returning_client_gets_each_step_once(tmp_path: Path) -> None:
    disk = FullDisk(tmp_path)
    async with serving(tmp_path, storage=disk) as server, raw(server, name="bob") as bob:
        async with raw(server, name="ada") as ada:
            options = {"clock": "realtime", "step_rate": 20, "absence": "wait"}
            joined = await seated(ada, bob, **options)
            seen = (await ada.expect("delta"))["step"]
        room = server.lobby.find(joined["code"])
        await asyncio.sleep(0.2)
        disk.full = True
        while not room.problem:
            await asyncio.sleep(0.01)
        assert room.episode.step > seen
        async with raw(server, hello=False) as again:
            known = {"episode": joined["episode"], "step": seen, "said": 0}
            hello = {**HELLO, "resume": joined["resume"], "seen": known}
            await again.send(hello)
            await again.expect("welcome")
            await asyncio.sleep(0.1)
            disk.full = False
            steps: list[int] = []
            while not steps or steps[-1] < room.episode.step:
                message = await again.expect("snapshot", "delta")
                if message["type"] == "snapshot":
                    steps = []
                steps.append(message["step"])
            assert seen < steps[0]
            assert steps == list(range(steps[0], steps[-1] + 1))


@pytest.mark.slow
@virtual
async def test_reconnections_during_a_full_disk_do_not_accumulate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Clients that are refused can come back later with the same token."""
    monkeypatch.setattr(write_ahead, "MAX_UNWRITTEN", 8192)
    disk = FullDisk(tmp_path)
    async with serving(tmp_path, storage=disk, messages_per_second=1000) as server:
        async with raw(server, name="bob") as bob:
            async with raw(server, name="ada") as ada:
                joined = await seated(ada, bob)
                room = server.lobby.find(joined["code"])
                await ada.send({"type": "act", "seq": 1, "action": None})
                disk.full = True
                await bob.send({"type": "act", "seq": 1, "action": None})
                while not room.problem:
                    await asyncio.sleep(0.1)
            assert room.journal is not None
            token, refused, waiting = joined["resume"], 0, 0
            for _ in range(100):
                async with raw(server, hello=False) as again:
                    hello = {**HELLO, "resume": token}
                    answer = await again.ask(hello, "welcome", "bye")
                if answer["type"] == "welcome":
                    assert not refused
                    token = answer["resume"]
                    continue
                assert (answer["code"], answer["retry"]) == ("server/recording", True)
                refused += 1
                waiting = waiting or room.journal.waiting
                assert room.journal.waiting == waiting, "it grows although all are refused"
            assert 8192 < waiting < 9216
            assert refused > 50
            disk.full = False
            await asyncio.sleep(2)
            async with raw(server, hello=False) as again:
                seen = {"episode": joined["episode"], "step": 0, "said": 0}
                hello = {**HELLO, "resume": token, "seen": seen}
                assert (await again.ask(hello, "welcome"))["resumed"] is True
                assert (await again.expect("joined"))["seat"] == joined["seat"]
                assert (await again.expect("delta", "snapshot"))["step"] == 1
                for one in (again, bob):
                    await one.send({"type": "act", "seq": 2, "action": None})
                assert (await again.expect("delta"))["step"] == 2
    (file,) = tmp_path.glob("*.rbt")
    assert read_recording(file).verify().ok


WITHHELD_ROSTERS_HELLO = {"type": "hello", "protocol": 1}
ACT = {"type": "act", "seq": 1, "action": None}


@asynccontextmanager
async def playing(
    server: Server, ada: Raw, bob: Raw, **options: Any
) -> AsyncIterator[tuple[Raw, Room, dict[str, Any]]]:
    """Run an episode with Ada, Bob and the spectator Eve; yield Eve, the room and her `joined`."""
    request = {"type": "create", "task": "multi_agent/02", "clock": "lockstep", **options}
    created = await ada.ask(request, "created")
    join = {"type": "join", "episode": created["code"]}
    async with raw(server, name="eve") as eve:
        joined = await eve.ask({**join, "role": "spectator"}, "joined")
        for one in (ada, bob):
            assert (await one.ask(join, "joined"))["type"] == "joined"
        await reported(ada)
        yield eve, server.lobby.find(created["code"]), joined


async def reported(one: Raw, seconds: float = 1.5) -> list[dict[str, Any]]:
    """Return all messages of some seconds."""
    got = []
    try:
        async with asyncio.timeout(seconds):
            while True:
                got.append(await one.receive())
    except TimeoutError:
        return got


def shown(messages: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Return the phases and pauses in the rosters among some messages."""
    return [
        (one["phase"], one.get("pause", {}).get("reason", ""))
        for one in messages
        if one["type"] == "roster"
    ]


@virtual
async def test_unwritten_end_is_not_sent(tmp_path: Path) -> None:
    """Not even when a spectator comes or goes."""
    disk = FullDisk(tmp_path)
    async with (
        serving(tmp_path, storage=disk) as server,
        raw(server, name="ada") as ada,
        raw(server, name="bob") as bob,
    ):
        async with playing(server, ada, bob, max_steps=1) as (eve, room, joined):
            disk.full = True
            for one in (ada, bob):
                await one.send(ACT)
            assert shown(await reported(ada)) == [("paused", "storage")]
            assert room.episode.ended
            await eve.socket.close()
            assert await reported(ada) == []
        seen = {"episode": room.id, "step": 0, "said": 0}
        async with raw(server, hello=False) as again:
            hello = {
                **WITHHELD_ROSTERS_HELLO,
                "name": "eve",
                "resume": joined["resume"],
                "seen": seen,
            }
            await again.send(hello)
            assert [one["type"] for one in await reported(again)] == ["welcome"]
            assert await reported(ada) == []
            disk.full = False
            kinds = [one["type"] for one in await reported(again)]
            assert kinds[0] == "joined"
            assert "ended" in kinds or "snapshot" in kinds
            received = await reported(ada)
            assert [one["type"] for one in received] == ["delta", "ended", "roster"]
            assert (shown(received), received[-1]["spectators"]) == ([("ended", "")], 1)


@virtual
async def test_lost_seat_is_sent_once_it_is_written(tmp_path: Path) -> None:
    disk = FullDisk(tmp_path)
    async with serving(tmp_path, storage=disk) as server, raw(server, name="ada") as ada:
        async with raw(server, name="bob") as bob:
            async with playing(server, ada, bob) as (eve, _room, _joined):
                disk.full = True
                await bob.socket.close()
                (roster,) = await reported(ada)
                assert shown([roster]) == [("paused", "storage")]
                assert [seat["present"] for seat in roster["seats"]] == [True, True]
                await eve.ask({"type": "leave"}, "left")
                assert await reported(ada) == []
                disk.full = False
                later = [one for one in await reported(ada) if one["type"] == "roster"]
                seats = [seat.get("present", False) for seat in later[-1]["seats"]]
                assert seats == [True, False]
                assert "spectators" not in later[-1]
