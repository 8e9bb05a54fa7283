"""An export is whole, or not there."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille_data.errors import CatalogueError
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
    with pytest.raises(OSError, match="No space"), whole_folder(tmp_path / "out") as draft:
        (draft / "x").write_text("x")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert not list(tmp_path.iterdir())


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
