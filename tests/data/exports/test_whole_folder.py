"""An export is whole, or not there."""

from __future__ import annotations

import errno
import resource
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from sqlalchemy.engine import URL

from robotouille_data.errors import CatalogueError
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import ExportFormat, Request
from robotouille_data.exports.whole_folder import whole_folder


def test_what_is_written_is_there_in_the_end(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    with whole_folder(folder) as draft:
        (draft / "x").write_text("x")
        assert not folder.exists()
    assert [path.name for path in folder.parent.iterdir()] == ["b"]
    assert (folder / "x").read_text() == "x"


def test_an_empty_folder_is_filled(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    with whole_folder(folder) as draft:
        (draft / "x").write_text("x")
    assert (folder / "x").exists()


def test_nothing_half_stays(tmp_path: Path) -> None:
    with (
        pytest.raises(CatalogueError, match="out cannot be written: No space"),
        whole_folder(tmp_path / "out") as draft,
    ):
        (draft / "x").write_text("x")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_one_that_fails_leaves_another_alone(tmp_path: Path) -> None:
    """Also from two containers, in which processes have the same numbers."""
    with whole_folder(tmp_path / "out") as draft:
        (draft / "x").write_text("x")
        with pytest.raises(RuntimeError), whole_folder(tmp_path / "out"):
            raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out/x").exists()


def test_of_two_at_once_the_first_to_be_whole_is_there(tmp_path: Path) -> None:
    with (
        pytest.raises(CatalogueError, match="cannot be written"),
        whole_folder(tmp_path / "out") as late,
    ):
        (late / "x").write_text("late")
        with whole_folder(tmp_path / "out") as early:
            (early / "x").write_text("early")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out/x").read_text() == "early"


def test_what_is_there_stays(tmp_path: Path) -> None:
    full, file, link = tmp_path / "full", tmp_path / "file", tmp_path / "link"
    full.mkdir()
    file.write_text("mine")
    (full / "mine").write_text("mine")
    link.symlink_to(tmp_path / "nowhere")
    for path in (full, file, link):
        with pytest.raises(CatalogueError, match="is there already"), whole_folder(path):
            raise AssertionError("nothing is written")
    assert (full / "mine").read_text() == file.read_text() == "mine"


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        pytest.raises(CatalogueError, match="cannot be written"),
        whole_folder(tmp_path / "file/x"),
    ):
        raise AssertionError("nothing is written")


@pytest.mark.parametrize("format_", ["csv", "jsonl", "chat", "arrays"])
def test_a_full_disk_leaves_nothing(url: URL, tmp_path: Path, format_: str) -> None:
    """Files may be as large here as what SQLite shares with other readers, and no larger."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (33 * 1024, hard))
    try:
        with pytest.raises(CatalogueError, match=r"out cannot be written: .*File too large"):
            export(url, tmp_path / "out", Request((ExportFormat(format_),)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.iterdir())
