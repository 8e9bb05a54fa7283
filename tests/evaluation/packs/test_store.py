"""Packs on disk: written whole, read back equal, and never read when damaged."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.published.checkout import read_checkout
from robotouille_evaluation.packs.store import default_folder, read_pack, write_pack
from tests.support.checkouts import write_checkout

pytest.importorskip("yaml")


@pytest.fixture
def pack(tmp_path: Path) -> Pack:
    return read_checkout(write_checkout(tmp_path / "checkout"), seeds=[42]).pack


@pytest.fixture
def folder(tmp_path: Path, pack: Pack) -> Path:
    folder = tmp_path / "packs" / "toast"
    write_pack(pack, folder)
    return folder


def test_a_pack_comes_back_equal(folder: Path, pack: Pack) -> None:
    found = read_pack(folder)
    assert found == pack
    assert found.digest == pack.digest
    assert read_pack(folder, digest=pack.digest) == pack


def test_a_pack_is_replaced_and_nothing_else_is_left(folder: Path, pack: Pack) -> None:
    write_pack(pack, folder)
    assert read_pack(folder) == pack
    assert [path.name for path in folder.parent.iterdir()] == ["toast"]


def test_the_same_pack_is_the_same_files(folder: Path, pack: Pack, tmp_path: Path) -> None:
    write_pack(pack, tmp_path / "again")
    for path in folder.iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, pack: Pack) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("x")
    with pytest.raises(FileError, match="is there, and is no pack"):
        write_pack(pack, tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter.tex").read_text() == "x"


def test_a_write_that_fails_leaves_the_old_pack(
    folder: Path, pack: Pack, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FileError, match="cannot be written: No space left on device"):
        write_pack(pack, folder)
    monkeypatch.undo()
    assert read_pack(folder) == pack
    assert [path.name for path in folder.parent.iterdir()] == ["toast"]


def test_an_interruption_leaves_the_old_pack(
    folder: Path, pack: Pack, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Path.replace

    def interrupted(path: Path, target: Path) -> Path:
        if path.suffix == ".part":
            raise KeyboardInterrupt
        return whole(path, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_pack(pack, folder)
    monkeypatch.undo()
    assert read_pack(folder) == pack
    assert [path.name for path in folder.parent.iterdir()] == ["toast"]


def test_of_a_checkout_a_pack_can_be_made(tmp_path: Path, pack: Pack) -> None:
    with pytest.raises(FileError, match=r"`robotouille pack import .*checkout` makes one"):
        read_pack(tmp_path / "checkout")


def test_missing_and_changed_files_are_all_named(folder: Path) -> None:
    (folder / "prompts.json").unlink()
    (folder / "tasks.json").write_text("[]")
    with pytest.raises(FileError) as caught:
        read_pack(folder)
    words = {str(fault) for fault in caught.value.faults}
    assert words == {
        "prompts.json: is missing",
        "tasks.json: was changed since the pack was made",
    }


def test_a_pack_of_another_digest_is_an_error(folder: Path) -> None:
    with pytest.raises(FileError, match="is another pack: expected the digest 0000"):
        read_pack(folder, digest="0" * 64)


def test_a_folder_without_a_pack_is_an_error(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"has no manifest\.json; did you mean 'toast'"):
        read_pack(folder.with_name("toats"))
    with pytest.raises(FileError, match=r"is no pack: it has no manifest\.json"):
        read_pack(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "robotouille-pack/2"}, "format: expected 'robotouille-pack/1', found"),
        ({"files": ["domain.json"]}, "files: expected file names with their hashes"),
        ({"files": {"../secret": "0"}}, "files: expected file names with their hashes"),
        ({"files": {"/etc/passwd": "0"}}, "files: expected file names with their hashes"),
        ({"files": {}}, "is not laid out as a pack"),
        ({"digest": 1}, "digest: expected a text, found 1"),
        ({"digest": "0" * 64}, "digest: expected"),
        ({"name": "other"}, "digest: expected"),
    ],
)
def test_a_wrong_manifest_is_an_error(folder: Path, change: dict[str, Any], words: str) -> None:
    path = folder / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(FileError, match=re.escape(words)):
        read_pack(folder)


@pytest.mark.parametrize("text", ["", "{", "[]", "\udcff", "\x00"])
def test_a_manifest_that_is_none_is_an_error(folder: Path, text: str) -> None:
    (folder / "manifest.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(FileError):
        read_pack(folder)


def test_the_default_folder_is_named_after_the_pack() -> None:
    assert default_folder("published") == Path("packs/published")
