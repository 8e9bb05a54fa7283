"""Full disks and unwritable folders: episodes are paused and lose nothing."""

from __future__ import annotations

import asyncio
import errno
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille import ProtocolError
from robotouille.replay.recording import read_recording
from robotouille_client import ChatReceived, Game, StateChanged, connect
from robotouille_server.rooms.recording.folder_lister import LIST_SECONDS
from robotouille_server.rooms.recording.storage import Appender, Folder
from tests.support.disks import FullDisk, TroubledFolder
from tests.support.lost_connections import miss_a_step
from tests.support.metrics import sample
from tests.support.servers import crash, serving, with_clients
from tests.support.virtual_time import run, virtual


@virtual
async def test_episode_is_paused_until_the_disk_has_room(tmp_path: Path) -> None:
    disk = FullDisk(tmp_path)
    async with with_clients(tmp_path, "ada", "bob", storage=disk) as (host, ada, bob):
        created = await ada.create("multi_agent/02", clock="realtime")
        one, two = await ada.join(created.code), await bob.join(created.code)
        while one.step < 5:
            await asyncio.sleep(0.1)
        disk.full = True
        room = host.lobby.find(created.code)
        two.say("can you hear me?")
        await asyncio.sleep(3)
        step = one.step
        assert (one.paused, two.paused) == (True, True)
        assert one.pause is not None
        assert one.pause.reason == "storage"
        assert "No space left" in room.problem
        assert sample(host.metrics, "failing_recordings") == 1
        assert not [e for e in one.poll() if isinstance(e, ChatReceived)], "told, but not written"
        with pytest.raises(ProtocolError, match="No space left"):
            async with connect(host.url, name="eve") as eve:
                await eve.join(created.code, role="spectator")
        await asyncio.sleep(20)
        assert one.step == step
        disk.full = False
        await asyncio.sleep(2)
        assert not one.paused
        assert one.step > step
        assert [e.text for e in one.poll() if isinstance(e, ChatReceived)] == ["can you hear me?"]
        assert room.problem == ""
        assert sample(host.metrics, "failing_recordings") == 0
        assert one.state.digest == two.state.digest
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = [note for note in recording.notes() if note["note"] in ("paused", "resumed", "said")]
    assert ["storage"] in [note.get("holds") for note in notes]
    assert [note["text"] for note in notes if note["note"] == "said"] == ["can you hear me?"]


@virtual
async def test_snapshot_waits_for_unwritten_events(tmp_path: Path) -> None:
    """Otherwise, a crash would contradict the snapshot."""
    disk = FullDisk(tmp_path)
    async with with_clients(tmp_path, "ada", storage=disk) as (_, ada):
        game = await ada.join((await ada.create("synchronous/01")).code)
        await game.act(game.actions[0])
        disk.full = True
        pending = game.submit(game.actions[0])
        await asyncio.sleep(0.5)
        miss_a_step(game)
        await asyncio.sleep(3)
        assert (game.step, pending.done()) == (1, False)
        disk.full = False
        await asyncio.sleep(2)
        assert (game.step, pending.done()) == (2, True)


@virtual
async def test_unclosed_recording_is_closed_at_the_next_start(tmp_path: Path) -> None:
    disk = FullDisk(tmp_path)
    async with with_clients(tmp_path, "ada", storage=disk) as (_, ada):
        game = await ada.join((await ada.create("synchronous/01", max_steps=1)).code)

        def fill(name: str, content: bytes) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        disk.replace = fill  # type: ignore[method-assign]
        await game.act(None)
        assert game.finished
    assert len(list(tmp_path.glob("*.part"))) == 1
    async with serving(tmp_path, seed=2):
        pass
    (file,) = tmp_path.glob("*.rbt")
    assert read_recording(file).verify().complete


class TestFolder:
    def test_file_has_one_writer(self, tmp_path: Path) -> None:
        one, two = Folder(tmp_path), Folder(tmp_path)
        file = one.create("a.rbt.part")
        with pytest.raises(BlockingIOError):
            two.resume("a.rbt.part")
        with pytest.raises(FileExistsError):
            two.create("a.rbt.part")
        file.append(b"abc")
        file.close()
        again = two.resume("a.rbt.part")
        again.append(b"def")
        again.cut(5)
        again.append(b"!")
        assert one.read("a.rbt.part") == b"abcde!"

    def test_failed_append_leaves_the_file_unchanged(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        folder = Folder(tmp_path)
        file = folder.create("a")
        file.append(b"whole")
        genuine = os.pwrite

        def half(descriptor: int, data: bytes, offset: int) -> int:
            if len(data) < 4:
                raise OSError(errno.ENOSPC, "No space left on device")
            return genuine(descriptor, data[: len(data) // 2], offset)

        monkeypatch.setattr(os, "pwrite", half)
        with pytest.raises(OSError, match="No space"):
            file.append(b"a long piece that does not fit")
        assert folder.read("a") == b"whole"
        monkeypatch.setattr(os, "pwrite", genuine)
        file.append(b" again")
        assert folder.read("a") == b"whole again"

    @pytest.mark.parametrize("name", ["../a", "/etc/passwd", "b/c", ".."])
    def test_names_cannot_leave_the_folder(self, tmp_path: Path, name: str) -> None:
        for act in (Folder(tmp_path).read, Folder(tmp_path).resume, Folder(tmp_path).remove):
            with pytest.raises(OSError, match=r"."):
                act(name)


@virtual
async def test_full_disk_at_startup_loses_no_episode(tmp_path: Path) -> None:
    async with serving(tmp_path) as first, connect(first.url, name="ada") as ada:
        game = await ada.join((await ada.create("synchronous/01")).code)
        await game.act(game.actions[0])
        port = first.port
        await crash(first)
        disk = StubbornDisk(tmp_path)
        async with serving(tmp_path, seed=2, port=port, storage=disk) as second:
            assert not second.lobby.rooms
            assert "No space left" in next(iter(second.lobby.unrestored.values()))
            await asyncio.sleep(10)
            assert not game.ended
            disk.full = False
            assert (await game.act(None)).applied
            assert second.lobby.unrestored == {}
            assert game.step == 2


@virtual
async def test_recording_that_was_moved_away_is_no_longer_reported(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    async with serving(folder) as first, connect(first.url, name="ada") as ada:
        await ada.create("synchronous/01")
        await crash(first)
        async with serving(folder, seed=2, storage=StubbornDisk(folder)) as second:
            (name,) = second.lobby.unrestored
            (folder / name).rename(tmp_path / name)
            await asyncio.sleep(2 * LIST_SECONDS)
            assert second.lobby.unrestored == {}


class StubbornDisk(Folder):
    """Folder in which existing files cannot be opened for a while."""

    full = True

    def resume(self, name: str) -> Appender:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().resume(name)


PATIENCE = 60
"""Seconds after which what a test waits for has not happened."""
ALONE: dict[str, Any] = {"task": "synchronous/01", "clock": "realtime", "max_steps": 100_000}


@asynccontextmanager
async def two_kitchens(url: str) -> AsyncIterator[tuple[Game, Game]]:
    """Run two episodes with one player each."""
    async with connect(url, name="ada") as ada, connect(url, name="bob") as bob:
        one = await ada.join((await ada.create(**ALONE)).code)
        two = await bob.join((await bob.create(**ALONE)).code)
        yield one, two


async def until(game: Game, reached: Callable[[Game], object]) -> list[Any]:
    """Read events until a condition holds; return them."""
    events: list[Any] = []
    async with asyncio.timeout(PATIENCE):
        while not reached(game):
            events.append(await game.next_event())
    return events


async def further(game: Game, steps: int) -> list[Any]:
    step = game.step + steps
    return await until(game, lambda game: game.step >= step)


def stands_still(game: Game) -> bool:
    return game.paused and game.pause is not None and game.pause.reason == "storage"


def assert_whole(file: Path, events: list[Any], said: list[str]) -> None:
    """Check that everything shown or said is in the recording."""
    recording = read_recording(file)
    assert recording.verify().ok
    assert [note["text"] for note in recording.notes() if note["note"] == "said"] == said
    recorded = {step: state.digest for step, state in recording.states()}
    shown = {event.step: event.state.digest for event in events if isinstance(event, StateChanged)}
    assert list(shown) == list(range(min(shown), max(shown) + 1))
    assert shown.items() <= recorded.items()


def holds(file: Path) -> list[list[str]]:
    """Return the reasons of all pauses, in order."""
    return [note["holds"] for note in read_recording(file).notes() if "holds" in note]


class OneBadFile(TroubledFolder):
    """Folder on a disk with a fault under one file."""

    bad = ""

    def before_append(self, name: str) -> None:
        if self.bad and self.bad in name:
            raise OSError(errno.EIO, "Input/output error")


def test_bad_file_pauses_only_its_episode(tmp_path: Path) -> None:

    async def main() -> tuple[str, str, list[Any]]:
        disk = OneBadFile(tmp_path)
        async with serving(tmp_path, storage=disk, step_rate=10) as server:
            async with two_kitchens(server.url) as (broken, well):
                seen = await further(broken, 5)
                disk.bad = broken.episode
                seen += await until(broken, stands_still)
                step, begun = broken.step, asyncio.get_running_loop().time()
                await further(well, 100)
                assert asyncio.get_running_loop().time() - begun < 10.5
                assert (broken.step, well.paused, stands_still(broken)) == (step, False, True)
                assert sample(server.metrics, "failing_recordings") == 1
                disk.bad = ""
                seen += await until(broken, lambda game: not game.paused)
                seen += await further(broken, 5)
                assert sample(server.metrics, "failing_recordings") == 0
                return broken.episode, well.episode, seen

    broken, well, seen = run(main())
    (file,), (other,) = tmp_path.glob(f"*{broken}.rbt"), tmp_path.glob(f"*{well}.rbt")
    assert_whole(file, seen, [])
    assert ["storage"] in holds(file)
    assert ["storage"] not in holds(other)
