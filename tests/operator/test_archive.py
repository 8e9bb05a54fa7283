"""Downloads of several recordings as one tar file."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path
from typing import BinaryIO

import pytest

from robotouille.protocol import messages
from robotouille.replay.recording import Recording
from robotouille_server.operator.recordings.archive import LEFT_OUT, archive
from robotouille_server.operator.recordings.store import DOWNLOAD_PIECE
from robotouille_server.rooms.recording.storage import Folder
from tests.support.operator import audited, bearer, table, viewing
from tests.support.virtual_time import virtual


def content(number: int) -> bytes:
    """Return the bytes of a damaged file, which is downloaded as it is."""
    return bytes([number]) * (700 + number)


def filled(folder: Path, count: int) -> dict[str, bytes]:
    """Write files to a folder, and return them by their names."""
    files = {f"20250101T00000{n}Z_soup_{n}.rbt": content(n) for n in range(count)}
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return files


def unpacked(data: bytes) -> dict[str, bytes]:
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        return {one.name: tar.extractfile(one).read() for one in tar}  # type: ignore[union-attr]


@virtual
async def test_archive_has_the_named_recordings_or_those_of_a_search(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        files = filled(tmp_path, 5)
        (tmp_path / "notes.txt").write_text("no recording")
        answer = await api.http.get("/api/archive")
        assert answer.headers["content-type"] == "application/x-tar"
        assert answer.headers["content-disposition"] == 'attachment; filename="recordings.tar"'
        assert unpacked(answer.content) == files
        some = sorted(files)[1:3]
        answer = await api.http.get("/api/archive", params={"name": some})
        assert unpacked(answer.content) == {name: files[name] for name in some}
        answer = await api.http.get("/api/archive", params={"search": "soup_4"})
        assert list(unpacked(answer.content)) == [sorted(files)[4]]
    (line,) = [line for line in audited(tmp_path) if line.get("count") == "2"]
    assert line["what"] == "archive"


@virtual
async def test_open_recording_is_archived_up_to_its_last_frame(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (server, _, api), table(server, max_steps=20) as play:
        await play.until(lambda game: game.step >= 5)
        server.lobby.rooms[play.episode].pause()
        live = (await api.row(play.episode))["recording"]["name"]
        with (tmp_path / live).open("ab") as file:
            file.write(b"\x99\x00\x00\x00torn")
        (data,) = unpacked((await api.http.get("/api/archive")).content).values()
        assert Recording(data).verify().ok


class Closing(Folder):
    """Folder whose first recording is closed and whose second is lost while it is archived."""

    def open(self, name: str) -> BinaryIO:
        if name.endswith("soup_1.rbt.part"):
            path = self.path / name
            path.rename(path.with_suffix(""))
        if name.endswith("soup_2.rbt"):
            (self.path / name).unlink(missing_ok=True)
        return super().open(name)


@virtual
async def test_files_that_change_or_vanish_do_not_spoil_the_archive(tmp_path: Path) -> None:
    async with viewing(tmp_path, storage=Closing(tmp_path)) as (_, _, api):
        first, closing, lost = filled(tmp_path, 3)
        (tmp_path / closing).rename(tmp_path / f"{closing}.part")
        found = unpacked((await api.http.get("/api/archive")).content)
        left_out = found.pop(LEFT_OUT).decode()
        assert left_out.startswith(f"{lost}: ")
        assert left_out.count("\n") == 1
        assert found == {first: content(0), f"{closing}.part": content(1)}


async def test_archive_is_made_in_pieces() -> None:
    size = 4 * DOWNLOAD_PIECE + 1

    async def opened(name: str) -> tuple[BinaryIO, int]:
        return io.BytesIO(bytes(size)), size

    made = [piece async for piece in archive(["long.rbt"], opened, time=0.0)]
    assert max(map(len, made)) <= DOWNLOAD_PIECE
    assert unpacked(b"".join(made)) == {"long.rbt": bytes(size)}


@virtual
async def test_limits_are_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotouille_server.operator.recordings.stored_recordings.MAX_ARCHIVED", 3)
    async with viewing(tmp_path) as (_, _, api):
        files = filled(tmp_path, 4)
        answer = await api.http.get("/api/archive")
        assert (answer.status_code, answer.json()["field"]) == (400, "search")
        assert "4 recordings match" in answer.json()["message"]
        for name in ("../secret.rbt", "notes.txt", "nothing.rbt"):
            answer = await api.http.get("/api/archive", params={"name": [*files, name]})
            assert (answer.status_code, answer.json()["code"]) == (404, "recording/unknown")
        answer = await api.http.get("/api/archive", params={"name": ["x.rbt"] * 101})
        assert (answer.status_code, answer.json()["field"]) == (400, "name")


@virtual
async def test_token_for_one_episode_gets_its_recording_only(tmp_path: Path) -> None:
    async with viewing(tmp_path, tokens=True) as (server, _, api):
        files = filled(tmp_path, 2)
        room = server.lobby.create(messages.Create(labels={"pair": "p1"}))
        headers = bearer(server, episode=room.code)
        answer = await api.http.get("/api/archive", headers=headers)
        assert list(unpacked(answer.content)) == [room.journal.name]  # type: ignore[union-attr]
        params = {"name": list(files)}
        answer = await api.http.get("/api/archive", params=params, headers=headers)
        assert answer.status_code == 404
