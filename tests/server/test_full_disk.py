"""While a recording cannot be written: who is told what, and what must not pile up meanwhile."""

from __future__ import annotations

import asyncio
import errno
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server.rooms import write_ahead
from robotouille_server.rooms.recordings.storage import Appender, Folder
from robotouille_server.transport.peer import MAX_UNSENT, Peer
from tests.support.disks import FullDisk, WrappedFile
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run

HELLO = {"type": "hello", "protocol": 1, "name": "ada"}


async def seated(ada: Raw, bob: Raw, **options: object) -> dict[str, Any]:
    """Both have joined a game of two; what Ada was told of her seat."""
    request = {"type": "create", "task": "multi_agent/02", **options}
    join = {"type": "join", "episode": (await ada.ask(request, "created"))["code"]}
    joined = await ada.ask(join, "joined")
    assert (await bob.ask(join, "joined"))["type"] == "joined"
    return joined


class Unclosable(Folder):
    """A folder in which no recording gets its final name."""

    def replace(self, name: str, content: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


class CountedFile(WrappedFile):
    """Counts itself as open until it is closed."""

    def __init__(self, disk: CountingDisk, file: Appender) -> None:
        super().__init__(file)
        self._disk = disk
        disk.opened += 1
        disk.still_open += 1

    def close(self) -> None:
        self._disk.still_open -= 1
        super().close()


class CountingDisk(FullDisk):
    """A disk that knows how many of its files are open."""

    opened = still_open = 0

    def create(self, name: str) -> Appender:
        return CountedFile(self, super().create(name))


def test_who_missed_the_end_is_told_although_the_recording_was_not_closed(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, storage=Unclosable(tmp_path)) as server:
            async with raw(server) as ada, raw(server) as bob:
                joined = await seated(ada, bob)
            room = server.lobby.find(joined["code"])
            room.abort("the study is over")
            while not room.problem:  # A thread closes it: meanwhile no virtual time passes.
                await asyncio.sleep(0)
            assert "cannot be closed" in room.problem
            async with raw(server, hello=False) as again, asyncio.timeout(30):
                welcome = await again.ask({**HELLO, "resume": joined["resume"]}, "welcome")
                assert welcome["resumed"] is True
                assert (await again.expect("joined"))["episode"] == joined["episode"]
                assert (await again.expect("snapshot"))["outcome"]["reason"] == "aborted"

    run(main())


def test_episodes_that_cannot_be_opened_leave_no_file_open(tmp_path: Path) -> None:
    async def main() -> None:
        disk = CountingDisk(tmp_path)
        disk.full = True
        async with serving(tmp_path, storage=disk) as server, raw(server) as ada:
            for _ in range(20):
                answer = await ada.ask({"type": "create"}, "created")
                assert answer["code"] == "server/recording"
                await asyncio.sleep(1)
            assert (disk.opened, disk.still_open) == (20, 0)
            assert not list(tmp_path.iterdir())

    run(main())


def test_a_slow_reader_catches_up_with_nothing_that_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has read all that it had just when the disk is full: its picture waits until then."""

    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as server,
            connect(server.url, name="ada") as ada,
            connect(server.url, name="bob") as bob,
        ):
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

    run(main())


@pytest.mark.parametrize("kind", ["say", "act"])
def test_what_is_said_and_done_meanwhile_does_not_pile_up(tmp_path: Path, kind: str) -> None:
    """The disk may be full for hours: who goes on talking must not fill the memory."""
    impossible = {"name": "move", "args": ["robot1", "table1", "table1"]}

    async def main() -> None:
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

    run(main())


def test_who_comes_back_meanwhile_is_welcomed_once_it_is_written(tmp_path: Path) -> None:
    """Asking for a snapshot in the meantime does not take the welcome's place."""

    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with serving(tmp_path, storage=disk) as server:
            async with raw(server, name="ada") as ada, raw(server, name="bob") as bob:
                joined = await seated(ada, bob, clock="realtime")
                room = server.lobby.find(joined["code"])
                disk.full = True
                while not room.problem:
                    await asyncio.sleep(0.1)
                async with raw(server, hello=False) as again:
                    await again.ask({**HELLO, "resume": joined["resume"]}, "welcome")
                    await again.send({"type": "resync"})
                    await asyncio.sleep(1)
                    assert room.problem
                    disk.full = False
                    async with asyncio.timeout(10):
                        assert (await again.expect("joined", "snapshot"))["type"] == "joined"
                        assert (await again.expect("snapshot"))["seat"] == joined["seat"]

    run(main())


def test_who_returns_while_the_disk_is_full_is_told_each_step_once(tmp_path: Path) -> None:
    """Steps are taken that are not told yet: what was missed ends with those that were."""

    async def main() -> None:
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

    run(main())


def test_coming_and_going_meanwhile_does_not_pile_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever cannot come back now can later, with the same token, and misses nothing."""
    monkeypatch.setattr(write_ahead, "MAX_UNWRITTEN", 8192)

    async def main() -> None:
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

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    assert read_recording(file).verify().ok
