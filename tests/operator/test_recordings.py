"""List, downloads and transcripts of recordings."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, BinaryIO

from robotouille.replay.compression import compress
from robotouille.replay.container import MAGIC, pack_frame
from robotouille.replay.recording import Recording, read_recording
from robotouille_server.operator.recordings.heads import PIECE
from robotouille_server.operator.recordings.store import DOWNLOAD_PIECE
from robotouille_server.rooms.recording.storage import Folder
from tests.support.operator import Disk, table, viewing
from tests.support.virtual_time import virtual


@virtual
async def test_open_recording_is_downloaded_up_to_its_last_frame(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server, max_steps=20) as play:
        await play.until(lambda game: game.step >= 5)
        server.lobby.rooms[play.episode].pause()
        live = (await api.row(play.episode))["recording"]["name"]
        whole = (tmp_path / live).read_bytes()
        with (tmp_path / live).open("ab") as file:
            file.write(b"\x99\x00\x00\x00torn")
        answer = await api.http.get(f"/api/recordings/{live}")
        assert answer.headers["content-disposition"] == f'attachment; filename="{live}"'
        assert answer.content == whole
        partial = Recording(answer.content)
        assert len(partial.steps) >= 5
        assert partial.verify().ok


@virtual
async def test_closed_recording_is_listed_and_downloaded(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api):
        async with table(server, max_steps=5) as play:
            await play.until(lambda game: game.outcome)
            await server.lobby.closed()
            row = (await api.get("/api/recordings"))["recordings"][0]
            assert row["outcome"] == "step_limit"
            assert (row["steps"], row["task"]) == (5, "multi_agent/01_lettuce_burger")
            assert row["episode"] is None
            answer = await api.http.get(f"/api/recordings/{row['name']}")
            assert answer.content == (tmp_path / row["name"]).read_bytes()
            assert row["size"] == len(answer.content)
            assert read_recording(tmp_path / row["name"]).verify().ok
            after = await api.row(play.episode)
            assert after["recording"]["name"] == row["name"]


@virtual
async def test_list_shows_outcomes(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        await play.until(lambda game: game.step >= 1)
        live = (await api.row(play.episode))["recording"]["name"]
        (tmp_path / "20250101T000000Z_old_1.rbt.part").write_bytes((tmp_path / live).read_bytes())
        (tmp_path / "20240101T000000Z_broken_2.rbt").write_bytes(b"not a recording")
        header = {"kind": "header", "created": "", "task": {"name": "x"}}
        forged = {"kind": "footer", "outcome": {"reason": "goal", "steps": "many"}}
        content = MAGIC + pack_frame(header) + pack_frame(forged)
        (tmp_path / "20230101T000000Z_forged_3.rbt").write_bytes(compress(content))
        (tmp_path / "notes.txt").write_text("no recording at all")
        rows = (await api.get("/api/recordings"))["recordings"]
        assert [(row["name"], row["outcome"]) for row in rows] == [
            (live, "live"),
            ("20250101T000000Z_old_1.rbt.part", "unfinished"),
            ("20240101T000000Z_broken_2.rbt", "unreadable"),
            ("20230101T000000Z_forged_3.rbt", "unreadable"),
        ]
        assert rows[0]["episode"] == play.episode
        found = await api.get("/api/recordings", params={"search": "OLD", "limit": 5})
        assert [row["name"] for row in found["recordings"]] == [rows[1]["name"]]


@virtual
async def test_recordings_are_found_by_code_labels_and_players(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api):
        for pair, names in (("p1", ("ada", "bob")), ("p2", ("cleo", "dan"))):
            create = {"max_steps": 2, "labels": {"pair": pair}}
            async with table(server, names=names, **create) as play:
                await play.until(lambda game: game.outcome)
        await server.lobby.closed()
        rows = (await api.get("/api/recordings"))["recordings"]
        last = next(row for row in rows if row["labels"] == {"pair": "p2"})
        assert last["code"].replace("-", "") == play.code.replace("-", "")
        assert last["players"] == ["cleo", "dan"]
        for search in (last["code"], play.code, "CLEO", "pair=p2", "dan lettuce pair=p2"):
            found = await api.get("/api/recordings", params={"search": search})
            assert [row["name"] for row in found["recordings"]] == [last["name"]], search
        assert (await api.get("/api/recordings", params={"search": "cleo p1"}))["found"] == 0


@virtual
async def test_search_reads_the_beginning_of_each_recording_once(tmp_path: Path) -> None:
    reads = Reads(tmp_path)
    async with viewing(tmp_path, storage=reads) as (server, _, api), table(server) as play:
        await play.until(lambda game: game.step >= 1)
        live = server.storage.names()[0]  # type: ignore[union-attr]
        content = (tmp_path / live).read_bytes() + bytes(8 * PIECE)
        for number in range(3):
            (tmp_path / f"20250101T000000Z_old_{number}.rbt.part").write_bytes(content)
        nobody = {"params": {"search": "nobody"}}
        assert (await api.get("/api/recordings", **nobody))["found"] == 0
        assert 0 < reads.bytes < 4 * 4 * PIECE
        before = reads.bytes
        assert (await api.get("/api/recordings", **nobody))["found"] == 0
        assert reads.bytes == before


@virtual
async def test_files_outside_the_list_cannot_be_downloaded(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    (tmp_path / "secret.rbt").write_text("outside")
    async with viewing(folder) as (_, _, api):
        (folder / "notes.txt").write_text("inside, but no recording")
        tried = [
            "../secret.rbt", "..%2Fsecret.rbt", "%2e%2e%2fsecret.rbt", "notes.txt",
            str(tmp_path / "secret.rbt").replace("/", "%2F"), "nothing.rbt", "..", "%00.rbt",
        ]  # fmt: skip
        for name in tried:
            answer = await api.http.get(f"/api/recordings/{name}")
            assert answer.status_code == 404, name
            assert answer.json()["code"] in ("recording/unknown", "request/unknown"), name


@virtual
async def test_server_without_recordings_lists_none(tmp_path: Path) -> None:
    async with viewing(tmp_path, record=False) as (server, _, api), table(server) as play:
        assert (await api.row(play.episode))["recording"] is None
        assert await api.get("/api/recordings") == {"found": 0, "recordings": []}
        assert (await api.get(f"/api/episodes/{play.episode}"))["lines"] == []


@virtual
async def test_unreadable_folder_is_reported(tmp_path: Path) -> None:
    class Locked(Disk):
        def names(self) -> list[str]:
            if self.full:
                raise PermissionError(13, "Permission denied")
            return super().names()

    disk = Locked(tmp_path)
    async with viewing(tmp_path, storage=disk) as (_, _, api):
        disk.full = True
        answer = await api.http.get("/api/recordings")
        assert answer.status_code == 503
        assert answer.json() == {
            "code": "recording/unreadable",
            "message": "the recordings folder cannot be read: Permission denied",
        }


class Reads(Folder):
    """Folder that counts the bytes that are read from its files."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.bytes = self.largest = 0

    def open(self, name: str) -> BinaryIO:
        return CountedFile(self, super().open(name))  # type: ignore[return-value]


class CountedFile:
    """File of a `Reads` folder."""

    def __init__(self, reads: Reads, file: BinaryIO) -> None:
        self._reads = reads
        self._file = file

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        self._reads.bytes += len(data)
        self._reads.largest = max(self._reads.largest, len(data))
        return data

    def __enter__(self) -> CountedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@virtual
async def test_events_of_an_episode_are_read_once_for_all_requests(tmp_path: Path) -> None:
    reads = Reads(tmp_path)
    async with viewing(tmp_path, storage=reads) as (server, _, api), table(server) as play:
        await play.until(lambda game: game.step >= 40)
        room = server.lobby.rooms[play.episode]
        room.pause()
        path = f"/api/episodes/{play.episode}"
        lines = (await api.get(path))["lines"]
        before = reads.bytes
        assert (await api.get(path))["lines"] == lines
        assert reads.bytes == before
        play.games[0].say("a short line")
        await asyncio.sleep(1)
        assert (await api.get(path))["lines"][-1]["text"] == "a short line"
        assert reads.bytes - before < 400


@virtual
async def test_list_reads_only_the_header_of_live_recordings(tmp_path: Path) -> None:
    reads = Reads(tmp_path)
    async with viewing(tmp_path, storage=reads) as (server, _, api), table(server) as play:
        await play.until(lambda game: game.step >= 1)
        journal = server.lobby.rooms[play.episode].journal
        assert journal is not None
        header = journal.size
        while journal.size < header + 4 * PIECE:
            action = play.games[0].state.actions("robot1")[0]
            await play.games[0].act(action, reasoning="x" * 8000)
            await asyncio.sleep(1)
        (row,) = (await api.get("/api/recordings"))["recordings"]
        assert (row["outcome"], row["task"]) == ("live", "multi_agent/01_lettuce_burger")
        assert row["size"] == journal.size
        assert reads.bytes < header + 2 * PIECE
        before = reads.bytes
        await api.get("/api/recordings")
        assert reads.bytes == before


@virtual
async def test_download_is_read_in_pieces(tmp_path: Path) -> None:
    reads = Reads(tmp_path)
    async with viewing(tmp_path, storage=reads) as (_, _, api):
        content = compress(b"") + bytes(3 * DOWNLOAD_PIECE + 1)
        (tmp_path / "20240101T000000Z_long_1.rbt").write_bytes(content)
        answer = await api.http.get("/api/recordings/20240101T000000Z_long_1.rbt")
        assert answer.content == content
        assert reads.largest == DOWNLOAD_PIECE
