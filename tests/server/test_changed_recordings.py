"""Recordings that other programs have changed, or that have invalid content."""

from __future__ import annotations

import asyncio
import os
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from robotouille import World
from robotouille.episode import Clock, Episode, Rules
from robotouille.protocol import messages
from robotouille.replay.container import MAX_FILE, frame_ends
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import Game, connect
from robotouille_server import Server
from robotouille_server.rooms.lobby import INSPECTION_SECONDS
from robotouille_server.rooms.recording.journal import Journal
from robotouille_server.rooms.recording.recovery import FORGET_SECONDS
from robotouille_server.rooms.recording.storage import Appender, Folder
from robotouille_server.rooms.room import Room
from tests.support.servers import crash, serving
from tests.support.virtual_time import run, virtual

TWO = World("multi_agent/01")


@asynccontextmanager
async def playing(server: Server) -> AsyncIterator[tuple[Game, Room, Path]]:
    """Run a real-time episode; yield its room and file."""
    async with connect(server.url, name="ada") as ada:
        created = await ada.create("synchronous/01", clock="realtime", max_steps=5000)
        game = await ada.join(created.code)
        while game.step < 3:
            await asyncio.sleep(0.1)
        room = server.lobby.find(created.code)
        assert room.journal is not None
        yield game, room, server.settings.recordings / room.journal.name


async def end(server: Server, room: Room) -> None:
    room.abort("the study is over")
    await server.lobby.closed()


def the_closed(folder: Path) -> Recording:
    (file,) = folder.glob("*.rbt")
    return read_recording(file)


class TestRemovedRecording:
    @virtual
    async def test_folder_removed_during_the_episode(self, tmp_path: Path) -> None:
        folder = tmp_path / "recordings"
        async with serving(folder) as server, playing(server) as (game, room, file):
            before = game.step
            shutil.rmtree(folder)
            await asyncio.sleep(INSPECTION_SECONDS + 1)
            assert Recording(file.read_bytes()).length > before, (
                "the recording was not written again"
            )
            with pytest.raises(BlockingIOError):
                Folder(folder).resume(file.name)
            assert room.problem == ""
            await end(server, room)
        recording = the_closed(folder)
        assert recording.verify().ok
        assert recording.outcome is not None
        assert not list(folder.glob("*.part"))

    @virtual
    async def test_just_before_the_end(self, tmp_path: Path) -> None:
        folder = tmp_path / "recordings"
        async with serving(folder) as server, playing(server) as (_, room, _):
            shutil.rmtree(folder)
            await end(server, room)
        assert the_closed(folder).verify().ok

    @virtual
    async def test_failed_repair_is_reported_to_the_operator(self, tmp_path: Path) -> None:
        class Stubborn(Folder):
            full = False

            def create(self, name: str) -> Appender:
                if self.full:
                    raise OSError(28, "No space left on device")
                return super().create(name)

        disk = Stubborn(tmp_path)
        async with serving(tmp_path, storage=disk) as server:
            async with playing(server) as (game, room, file):
                disk.full = True
                file.unlink()
                await asyncio.sleep(INSPECTION_SECONDS + 1)
                assert "removed" in room.problem
                assert "No space left" in room.problem
                step = game.step
                await asyncio.sleep(2)
                assert game.step > step
                disk.full = False
                await asyncio.sleep(INSPECTION_SECONDS + 1)
                assert room.problem == ""
                assert file.exists()
                await end(server, room)
        assert the_closed(tmp_path).verify().ok


class TestTruncatedRecording:
    def test_truncation_is_reported_and_the_file_is_not_closed(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with serving(tmp_path) as server, playing(server) as (game, room, file):
                ends = list(frame_ends(file.read_bytes()))
                os.truncate(file, ends[2] + 7)
                step = game.step
                while game.step < step + 2:  # Later appends restore the length.
                    await asyncio.sleep(0.1)
                await asyncio.sleep(INSPECTION_SECONDS + 1)
                assert "cut" in room.problem
                await end(server, room)
                assert "not closed" in room.problem

        with capture_logs() as logged:
            run(main())
        assert not list(tmp_path.glob("*.rbt"))
        (file,) = tmp_path.glob("*.part")
        assert "cut the recording short" in str(
            [row for row in logged if row.get("file") == file.name]
        )
        with pytest.raises(Exception, match="damaged"):
            read_recording(file)
        assert read_recording(file, damaged=True).header

    @pytest.mark.parametrize("cut", [True, False])
    @virtual
    async def test_change_just_before_the_end(self, tmp_path: Path, cut: bool) -> None:
        async with serving(tmp_path) as server, playing(server) as (_, room, file):
            with file.open("r+b") as open_file:
                if cut:
                    open_file.truncate(100)
                else:
                    open_file.seek(file.stat().st_size // 2)
                    open_file.write(b"???")
            await end(server, room)
            assert "not closed" in room.problem
        assert not list(tmp_path.glob("*.rbt"))


def begun() -> tuple[str, bytes]:
    """Return the file name and content of an unfinished recording."""
    episode = Episode(TWO, Rules(clock=Clock.REALTIME), 0.0)
    recorder = Recorder(TWO)
    head = header(TWO.task, episode.rules, episode="0123456789abcdef", created="2026")
    content = recorder.begin(head)
    for player in TWO.players:
        episode.join(player, player.upper(), "human", 0.0, session=f"s-{player}")
    episode.tick(2.5)
    content += recorder.record(episode.events())
    return "2026_multi_agent-01_lettuce_burger_0123456789abcdef.rbt.part", content


class TestFoundAtStart:
    @virtual
    async def test_copy_is_not_restored(self, tmp_path: Path) -> None:
        name, content = begun()
        copies = [f"copy_of_{name}", name.replace("abcdef", "abcdee")]
        for file in (name, *copies):
            (tmp_path / file).write_bytes(content)
        async with serving(tmp_path) as server:
            assert list(server.lobby.rooms) == ["0123456789abcdef"]
            assert set(server.lobby.unrestored) == set(copies)
            assert all(f"a copy of {name}" in why for why in server.lobby.unrestored.values())
            await crash(server)
        assert all((tmp_path / file).read_bytes() == content for file in copies)

    @virtual
    async def test_incomplete_end_is_kept_in_another_file(self, tmp_path: Path) -> None:
        name, content = begun()
        last = list(frame_ends(content))[-2]
        tails = [content[last : last + 30], bytes(700)]
        for tail in tails:
            (tmp_path / name).write_bytes(content[:last] + tail)
            async with serving(tmp_path) as server:
                assert len(server.lobby.rooms) == 1
                await crash(server)
        kept = [tmp_path / f"{name}.cut", tmp_path / f"{name}.cut2"]
        assert [file.read_bytes() for file in kept] == tails
        assert (tmp_path / name).read_bytes().startswith(content[:last])

    @virtual
    async def test_damaged_file_is_not_changed(self, tmp_path: Path) -> None:
        """One flipped bit in a length once cost everything behind it."""
        name, content = begun()
        damaged = bytearray(content)
        at = list(frame_ends(content))[3]
        damaged[at + 2] ^= 1
        (tmp_path / name).write_bytes(damaged)
        async with serving(tmp_path) as server:
            assert not server.lobby.rooms
            assert f"damaged at byte {at}" in server.lobby.unrestored[name]
        assert (tmp_path / name).read_bytes() == damaged
        assert len(list(tmp_path.iterdir())) == 1

    @virtual
    async def test_damaged_file_that_was_removed_is_no_longer_reported(
        self, tmp_path: Path
    ) -> None:
        name, content = begun()
        kept = f"copy_of_{name}"
        for file in (name, kept):
            (tmp_path / file).write_bytes(content[:40] + bytes([content[40] ^ 1]) + content[41:])
        async with serving(tmp_path) as server:
            assert set(server.lobby.unrestored) == {name, kept}
            (tmp_path / name).unlink()
            await asyncio.sleep(2 * FORGET_SECONDS)
            assert set(server.lobby.unrestored) == {kept}

    @virtual
    async def test_file_that_is_too_large_is_not_restored(self, tmp_path: Path) -> None:
        name, content = begun()
        (tmp_path / name).write_bytes(content)
        os.truncate(tmp_path / name, MAX_FILE + 1)
        async with serving(tmp_path) as server:
            assert not server.lobby.rooms
            assert "larger than 256 MiB" in server.lobby.unrestored[name]


class TestFolder:
    def test_links_are_not_followed(self, tmp_path: Path) -> None:
        secret = tmp_path / "secret"
        secret.write_bytes(b"RBTL, and nobody's business")
        folder = Folder(tmp_path / "recordings")
        folder.create("a.rbt.part").close()
        (folder.path / "b.rbt").symlink_to(secret)
        (folder.path / "c.rbt.new").symlink_to(secret)
        os.mkfifo(folder.path / "d.rbt")
        assert folder.names() == ["a.rbt.part"]
        for act in (folder.read, folder.resume):
            with pytest.raises(OSError, match=r"."):
                act("b.rbt")
        with pytest.raises(OSError, match=r"."):
            folder.replace("c.rbt", b"x")
        with pytest.raises(OSError, match=r"."):
            folder.read("d.rbt")
        assert secret.read_bytes().endswith(b"business")


@virtual
async def test_recording_of_an_ended_episode_is_not_inspected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "recordings"
    looked: list[Journal] = []
    look = Journal.repair_if_changed
    async with serving(folder) as server:
        order = messages.Create(task="synchronous/01")
        rooms = [server.lobby.create(order, owner="") for _ in range(3)]

        def look_and_end_the_others(journal: Journal) -> bool:
            looked.append(journal)
            anew = look(journal)
            for room in rooms:
                if room.journal not in looked:
                    room.abort("the study is over")
            return anew

        monkeypatch.setattr(Journal, "repair_if_changed", look_and_end_the_others)
        shutil.rmtree(folder)
        await asyncio.sleep(INSPECTION_SECONDS + 1)
        await server.lobby.closed()
        assert len(looked) == 1
        assert [file.name for file in folder.iterdir()] == [looked[0].name]
