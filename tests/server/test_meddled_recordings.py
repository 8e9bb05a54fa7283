"""What others do to the recordings of a running server, and what they leave for the next one."""

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
from robotouille.replay.container import frame_ends
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import Game, connect
from robotouille_server import Server
from robotouille_server.rooms.lobby import INSPECTION_SECONDS
from robotouille_server.rooms.recordings.storage import Appender, FileCondition, Folder
from robotouille_server.rooms.room import Room
from tests.support.servers import crash, serving
from tests.support.virtual_time import run

TWO = World("multi_agent/01")


@asynccontextmanager
async def playing(server: Server) -> AsyncIterator[tuple[Game, Room, Path]]:
    """A game in real time, its room, and its file."""
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


class TestRemoved:
    def test_the_folder_during_play(self, tmp_path: Path) -> None:
        folder = tmp_path / "recordings"

        async def main() -> None:
            async with serving(folder) as server, playing(server) as (game, room, file):
                before = game.step
                shutil.rmtree(folder)
                await asyncio.sleep(INSPECTION_SECONDS + 1)
                assert Recording(file.read_bytes()).length > before, "written anew, whole"
                with pytest.raises(BlockingIOError):
                    Folder(folder).resume(file.name)
                assert room.problem == ""
                await end(server, room)

        run(main())
        recording = the_closed(folder)
        assert recording.verify().ok
        assert recording.outcome is not None
        assert not list(folder.glob("*.part"))

    def test_just_before_the_end(self, tmp_path: Path) -> None:
        folder = tmp_path / "recordings"

        async def main() -> None:
            async with serving(folder) as server, playing(server) as (_, room, _):
                shutil.rmtree(folder)
                await end(server, room)

        run(main())
        assert the_closed(folder).verify().ok

    def test_where_no_new_one_can_be_made_the_operator_is_told(self, tmp_path: Path) -> None:
        class Stubborn(Folder):
            full = False

            def create(self, name: str) -> Appender:
                if self.full:
                    raise OSError(28, "No space left on device")
                return super().create(name)

        async def main() -> None:
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

        run(main())
        assert the_closed(tmp_path).verify().ok


class TestCutShort:
    def test_it_is_told_and_never_closed_into_garbage(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with serving(tmp_path) as server, playing(server) as (game, room, file):
                ends = list(frame_ends(file.read_bytes()))
                os.truncate(file, ends[2] + 7)
                step = game.step
                while game.step < step + 2:  # What comes then makes the file long again.
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

    def test_just_before_the_end(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with serving(tmp_path) as server, playing(server) as (_, room, file):
                os.truncate(file, 100)
                await end(server, room)
                assert "not closed" in room.problem

        run(main())
        assert not list(tmp_path.glob("*.rbt"))

    def test_changed_within(self, tmp_path: Path) -> None:
        async def main() -> None:
            async with serving(tmp_path) as server, playing(server) as (_, room, file):
                with file.open("r+b") as open_file:
                    open_file.seek(file.stat().st_size // 2)
                    open_file.write(b"???")
                await end(server, room)
                assert "not closed" in room.problem

        run(main())
        assert not list(tmp_path.glob("*.rbt"))
        assert len(list(tmp_path.glob("*.part"))) == 1


def begun(version: int = 2) -> tuple[str, bytes]:
    """The name of a game of two that runs, and what is recorded of it."""
    episode = Episode(TWO, Rules(clock=Clock.REALTIME), 0.0)
    recorder = Recorder(TWO, version)
    head = header(TWO.task, episode.rules, episode="0123456789abcdef", created="2026", code="X")
    content = recorder.begin(head)
    for player in TWO.players:
        episode.join(player, player.upper(), "human", 0.0, session=f"s-{player}")
    episode.tick(2.5)
    content += recorder.record(episode.events())
    return "2026_multi_agent-01_lettuce_burger_0123456789abcdef.rbt.part", content


class TestLeft:
    """What a server finds when it starts."""

    def test_a_copy_is_not_another_episode(self, tmp_path: Path) -> None:
        name, content = begun()
        copies = [f"copy_of_{name}", name.replace("abcdef", "abcdee")]
        for file in (name, *copies):
            (tmp_path / file).write_bytes(content)

        async def main() -> None:
            async with serving(tmp_path) as server:
                assert list(server.lobby.rooms) == ["0123456789abcdef"]
                assert set(server.lobby.unrestored) == set(copies)
                assert all(f"a copy of {name}" in why for why in server.lobby.unrestored.values())
                await crash(server)

        run(main())
        assert all((tmp_path / file).read_bytes() == content for file in copies)

    def test_what_is_torn_off_is_kept_beside(self, tmp_path: Path) -> None:
        name, content = begun()
        last = list(frame_ends(content))[-2]
        tails = [content[last : last + 30], bytes(700)]

        async def main() -> None:
            for tail in tails:
                (tmp_path / name).write_bytes(content[:last] + tail)
                async with serving(tmp_path) as server:
                    assert len(server.lobby.rooms) == 1
                    await crash(server)

        run(main())
        kept = [tmp_path / f"{name}.cut", tmp_path / f"{name}.cut2"]
        assert [file.read_bytes() for file in kept] == tails
        assert (tmp_path / name).read_bytes().startswith(content[:last])

    @pytest.mark.parametrize("version", [1, 2])
    def test_damage_is_left_as_it_is(self, tmp_path: Path, version: int) -> None:
        """One flipped bit in a length once cost all that came behind it."""
        name, content = begun(version)
        damaged = bytearray(content)
        at = list(frame_ends(content))[3]
        damaged[at + 2] ^= 1
        (tmp_path / name).write_bytes(damaged)

        async def main() -> None:
            async with serving(tmp_path) as server:
                assert not server.lobby.rooms
                assert f"damaged at byte {at}" in server.lobby.unrestored[name]

        run(main())
        assert (tmp_path / name).read_bytes() == damaged
        assert len(list(tmp_path.iterdir())) == 1

    def test_a_recording_goes_on_in_its_version(self, tmp_path: Path) -> None:
        name, content = begun(version=1)
        (tmp_path / name).write_bytes(content[:-3])

        async def main() -> None:
            async with serving(tmp_path) as server:
                (room,) = server.lobby.rooms.values()
                for player in TWO.players:
                    room.episode.set_present(player, True, asyncio.get_running_loop().time())
                room.flush()
                await asyncio.sleep(5)
                await end(server, room)

        run(main())
        recording = the_closed(tmp_path)
        assert recording.version == 1
        verification = recording.verify()
        assert verification.ok, verification.fault
        assert recording.length > Recording(content).length


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

    def test_a_file_knows_what_has_become_of_it(self, tmp_path: Path) -> None:
        folder = Folder(tmp_path)
        file = folder.create("a")
        file.append(b"whole")
        assert (file.condition(), file.read()) == (FileCondition.WHOLE, b"whole")
        (tmp_path / "a").unlink()
        file.append(b" still")
        assert (file.condition(), file.read()) == (FileCondition.REMOVED, b"whole still")
        other = folder.create("b")
        other.append(b"whole")
        os.truncate(tmp_path / "b", 2)
        other.append(b" again")
        assert other.condition() is FileCondition.CUT_SHORT
