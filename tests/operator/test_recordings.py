"""List, downloads and transcripts of recordings."""

from __future__ import annotations

from pathlib import Path

from robotouille.replay.recording import Recording, read_recording
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
        (tmp_path / "notes.txt").write_text("no recording at all")
        rows = (await api.get("/api/recordings"))["recordings"]
        assert [(row["name"], row["outcome"]) for row in rows] == [
            (live, "live"),
            ("20250101T000000Z_old_1.rbt.part", "unfinished"),
            ("20240101T000000Z_broken_2.rbt", "unreadable"),
        ]
        assert rows[0]["episode"] == play.episode
        found = await api.get("/api/recordings", params={"search": "OLD", "limit": 5})
        assert [row["name"] for row in found["recordings"]] == [rows[1]["name"]]


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
