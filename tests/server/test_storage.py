"""A full disk or an unwritable folder pauses an episode, and loses nothing."""

from __future__ import annotations

import asyncio
import errno
import os
from pathlib import Path

import pytest

from robotouille import ProtocolError
from robotouille.replay.recording import read_recording
from robotouille_client import Heard, connect
from robotouille_server.rooms.recordings.storage import Appender, Folder
from tests.support.disks import FullDisk
from tests.support.servers import crash, serving
from tests.support.virtual_time import run


def test_the_game_stands_still_until_there_is_room_again(tmp_path: Path) -> None:
    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with serving(tmp_path, storage=disk) as host:
            async with (
                connect(host.url, name="ada") as ada,
                connect(host.url, name="bob") as bob,
            ):
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
                assert host.metrics.failing._value.get() == 1
                assert not [e for e in one.poll() if isinstance(e, Heard)], "told, but not written"
                with pytest.raises(ProtocolError, match="No space left"):
                    async with connect(host.url, name="eve") as eve:
                        await eve.join(created.code, role="spectator")
                await asyncio.sleep(20)
                assert one.step == step
                disk.full = False
                await asyncio.sleep(2)
                assert not one.paused
                assert one.step > step
                assert [e.text for e in one.poll() if isinstance(e, Heard)] == ["can you hear me?"]
                assert room.problem == ""
                assert host.metrics.failing._value.get() == 0
                assert one.state.digest == two.state.digest

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = [note for note in recording.notes() if note["note"] in ("paused", "resumed", "said")]
    assert ["storage"] in [note.get("holds") for note in notes]
    assert [note["text"] for note in notes if note["note"] == "said"] == ["can you hear me?"]


def test_no_picture_shows_what_is_not_written(tmp_path: Path) -> None:
    """A client that asks for a snapshot meanwhile waits for it: a crash would belie it."""

    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as host,
            connect(host.url, name="ada") as ada,
        ):
            game = await ada.join((await ada.create("synchronous/01")).code)
            await game.act(game.actions[0])
            disk.full = True
            pending = game.submit(game.actions[0])
            await asyncio.sleep(0.5)
            game._resync()
            await asyncio.sleep(3)
            assert (game.step, pending.done()) == (1, False)
            disk.full = False
            await asyncio.sleep(2)
            assert (game.step, pending.done()) == (2, True)

    run(main())


def test_an_episode_that_cannot_be_recorded_is_not_opened(tmp_path: Path) -> None:
    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as host,
            connect(host.url, name="ada") as ada,
        ):
            disk.full = True
            blocked = disk.create("x.rbt.part")
            with pytest.raises(OSError, match="No space"):
                blocked.append(b"x")
            with pytest.raises(ProtocolError, match="No space left") as error:
                await ada.create("synchronous/01")
            assert error.value.code == "server/recording"
            disk.full = False
            assert (await ada.create("synchronous/01")).code

    run(main())


def test_a_recording_that_cannot_be_closed_is_closed_by_the_next_start(tmp_path: Path) -> None:
    async def main() -> None:
        disk = FullDisk(tmp_path)
        async with (
            serving(tmp_path, storage=disk) as host,
            connect(host.url, name="ada") as ada,
        ):
            game = await ada.join((await ada.create("synchronous/01", max_steps=1)).code)

            def fill(name: str, content: bytes) -> None:
                raise OSError(errno.ENOSPC, "No space left on device")

            disk.replace = fill  # type: ignore[method-assign]
            await game.act(None)
            assert game.over
        assert len(list(tmp_path.glob("*.part"))) == 1
        async with serving(tmp_path, seed=2):
            pass

    run(main())
    (file,) = tmp_path.glob("*.rbt")
    assert read_recording(file).verify().complete


class TestFolder:
    def test_a_file_is_written_by_one_process_at_a_time(self, tmp_path: Path) -> None:
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

    def test_a_failed_append_leaves_the_file_as_it_was(
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
    def test_names_do_not_lead_out_of_it(self, tmp_path: Path, name: str) -> None:
        for act in (Folder(tmp_path).read, Folder(tmp_path).resume, Folder(tmp_path).remove):
            with pytest.raises(OSError, match=r"."):
                act(name)


def test_a_full_disk_at_the_start_loses_no_episode(tmp_path: Path) -> None:
    """What is left of a recording cannot be completed yet: its clients are asked to wait."""

    async def main() -> None:
        async with serving(tmp_path) as first, connect(first.url, name="ada", seed=1) as ada:
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

    run(main())


class StubbornDisk(Folder):
    """A folder in which nothing that exists can be opened for writing, for a while."""

    full = True

    def resume(self, name: str) -> Appender:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().resume(name)
