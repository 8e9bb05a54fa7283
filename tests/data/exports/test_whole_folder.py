"""Folders of exports are complete or absent."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from sqlalchemy.engine import URL

from robotouille_data.database import CatalogueError
from robotouille_data.exports.exporting import export, whole_folder
from robotouille_data.exports.request import ExportFormat, ExportRequest


def test_folder_appears_when_complete(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    with whole_folder(folder) as draft:
        (draft / "x").write_text("x")
        assert not folder.exists()
    assert [path.name for path in folder.parent.iterdir()] == ["b"]
    assert (folder / "x").read_text() == "x"


def test_first_of_two_concurrent_exports_wins(tmp_path: Path) -> None:
    with (
        pytest.raises(CatalogueError, match="cannot be written"),
        whole_folder(tmp_path / "out") as late,
    ):
        (late / "x").write_text("late")
        with whole_folder(tmp_path / "out") as early:
            (early / "x").write_text("early")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out/x").read_text() == "early"


def test_existing_files_are_kept(tmp_path: Path) -> None:
    full, file, link = tmp_path / "full", tmp_path / "file", tmp_path / "link"
    full.mkdir()
    file.write_text("mine")
    (full / "mine").write_text("mine")
    link.symlink_to(tmp_path / "nowhere")
    for path in (full, file, link):
        with pytest.raises(CatalogueError, match="already exists"), whole_folder(path):
            raise AssertionError("nothing is written")
    assert (full / "mine").read_text() == file.read_text() == "mine"


@pytest.mark.parametrize("format_", ["csv", "jsonl", "chat", "arrays"])
def test_full_disk_leaves_nothing(url: URL, tmp_path: Path, format_: str) -> None:
    """The limit on file sizes leaves room only for SQLite's shared memory file."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (33 * 1024, hard))
    try:
        with pytest.raises(CatalogueError, match=r"out cannot be written: .*File too large"):
            export(url, tmp_path / "out", ExportRequest((ExportFormat(format_),)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.iterdir())
