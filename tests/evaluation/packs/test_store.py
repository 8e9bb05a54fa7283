"""Folders of packs: complete writes, equal reads, and damaged packs."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.packs.pack import Pack, Prompt
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.store import read_pack, write_pack
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


def test_pack_round_trip(folder: Path, pack: Pack) -> None:
    found = read_pack(folder)
    assert found == pack
    assert found.digest == pack.digest
    assert read_pack(folder, digest=pack.digest) == pack


def test_pack_is_replaced(folder: Path, pack: Pack) -> None:
    write_pack(pack, folder)
    assert read_pack(folder) == pack
    assert [path.name for path in folder.parent.iterdir()] == ["toast"]


def test_other_folders_are_not_replaced(tmp_path: Path, pack: Pack) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("x")
    with pytest.raises(FileError, match=r"not a pack: chapter\.tex; choose another"):
        write_pack(pack, tmp_path / "thesis")
    assert (tmp_path / "thesis" / "chapter.tex").read_text() == "x"


@pytest.mark.parametrize("file", ["certificate.json", "domain.json"])
def test_data_sets_with_a_manifest_are_not_replaced(tmp_path: Path, pack: Pack, file: str) -> None:
    data_set = tmp_path / "data set"
    data_set.mkdir()
    (data_set / "manifest.json").write_text('{"format": "robotouille-dataset/1"}')
    (data_set / file).write_text("{}")
    with pytest.raises(FileError, match=r"not a pack: .*; choose another"):
        write_pack(pack, data_set)
    assert len(list(data_set.iterdir())) == 2


def test_packs_with_notes_are_not_replaced(folder: Path, pack: Pack) -> None:
    (folder / "notes.txt").write_text("x")
    with pytest.raises(FileError, match=r"not a pack: notes\.txt; choose another"):
        write_pack(pack, folder)
    (folder / "notes.txt").unlink()
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps({**manifest, "format": "robotouille-pack/0"}))
    write_pack(pack, folder)
    assert read_pack(folder) == pack


def test_failed_write_keeps_the_old_pack(
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


@pytest.mark.parametrize("renames", [1, 2])
def test_killed_write_leaves_a_whole_pack(
    folder: Path, pack: Pack, monkeypatch: pytest.MonkeyPatch, renames: int
) -> None:
    """A kill between two renames left the pack as a draft, which the next write deleted."""
    new, copy = replace(pack, version="2"), folder.parent.parent / "copy"
    rename, done = Path.replace, []

    def counted(path: Path, target: Path) -> Path:
        found = rename(path, target)
        done.append(target)
        if len(done) == renames:
            shutil.copytree(folder.parent, copy)  # as the disk is after a kill now
        return found

    monkeypatch.setattr(Path, "replace", counted)
    write_pack(new, folder)
    monkeypatch.undo()
    killed = copy / "toast"
    assert read_pack(killed) == (pack, new)[renames - 1]
    write_pack(new, killed)
    assert read_pack(killed) == new
    assert [path.name for path in copy.iterdir()] == ["toast"]


def test_reading_a_checkout_suggests_import(tmp_path: Path, pack: Pack) -> None:
    with pytest.raises(
        FileError, match=r"convert a checkout with `robotouille pack import .*checkout`"
    ):
        read_pack(tmp_path / "checkout")


def test_missing_and_changed_files_are_listed(folder: Path) -> None:
    (folder / "prompts.json").unlink()
    (folder / "tasks.json").write_text("[]")
    with pytest.raises(FileError) as caught:
        read_pack(folder)
    words = {str(fault) for fault in caught.value.faults}
    assert words == {"prompts.json: is missing", "tasks.json: was changed since the pack was made"}


def test_other_digest_is_an_error(folder: Path) -> None:
    with pytest.raises(FileError, match="another pack: expected the digest 0000"):
        read_pack(folder, digest="0" * 64)


def test_folder_without_pack_is_an_error(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"has no manifest\.json; did you mean 'toast'"):
        read_pack(folder.with_name("toats"))
    with pytest.raises(FileError, match=r"not a pack: it has no manifest\.json"):
        read_pack(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "robotouille-pack/2"}, "format: expected 'robotouille-pack/1', found"),
        ({"files": ["domain.json"]}, "files: expected file names with their hashes"),
        ({"files": {"../secret": "0"}}, "files: expected file names with their hashes"),
        ({"files": {"/etc/passwd": "0"}}, "files: expected file names with their hashes"),
        ({"files": {"./tasks.json": "0"}}, "files: expected file names with their hashes"),
        ({"files": {"more.json": "0"}}, "files: expected file names with their hashes"),
        ({"files": {}}, "invalid pack"),
        ({"digest": 1}, "digest: expected a text, found 1"),
        ({"digest": "0" * 64}, "digest: expected"),
        ({"name": "other"}, "digest: expected"),
    ],
)
def test_invalid_manifest_is_an_error(folder: Path, change: dict[str, Any], words: str) -> None:
    path = folder / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(FileError, match=re.escape(words)):
        read_pack(folder)


@pytest.mark.slow
def test_pack_that_could_not_be_read_is_not_written(tmp_path: Path, pack: Pack) -> None:
    long = Prompt("long", "\1" * 17_000_000, "Six bytes of JSON for each character.")
    with pytest.raises(FileError, match="the pack is larger than 100,663,296 bytes"):
        write_pack(replace(pack, prompts=(long,)), tmp_path / "large")
    assert not (tmp_path / "large").exists()


def test_name_that_is_too_long_for_results_is_an_error(folder: Path, pack: Pack) -> None:
    tasks = tuple(replace(task, name="x" * 1001) for task in pack.tasks)
    write_pack(replace(pack, tasks=tasks), folder)
    with pytest.raises(FileError, match=r"tasks.0.name: String should have at most 1000"):
        read_pack(folder)


def replace_lists(folder: Path, content: bytes) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    for name in ("tasks.json", "instances.json", "prompts.json"):
        (folder / name).write_bytes(content)
        manifest["files"][name] = sha256(content).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.slow
def test_files_of_a_pack_are_bounded_together(folder: Path) -> None:
    replace_lists(folder, b"[" + b"[]," * 1_500_000 + b"[]]")
    with pytest.raises(FileError, match="values; at most 12,000,000"):
        read_pack(folder)
    replace_lists(folder, b"[" + b" " * 40_000_000 + b"]")
    with pytest.raises(FileError, match="the pack is larger than 100,663,296 bytes"):
        read_pack(folder)


@pytest.mark.parametrize("text", ["", "{", "[]", "\udcff", "\x00"])
def test_manifest_that_is_not_an_object(folder: Path, text: str) -> None:
    (folder / "manifest.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(FileError):
        read_pack(folder)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"optimal_steps": [5]}, "2 tasks, but 1 optimal_steps"),
        # The id would also name an agent in a Python module, which would be imported.
        ({"id": "kitchen:react"}, "kitchen:react: the id of an experiment has no colon"),
    ],
)
def test_invalid_experiment_is_an_error(
    folder: Path, change: dict[str, object], fault: str
) -> None:
    path, manifest = folder / "experiments.json", folder / "manifest.json"
    path.write_text(json.dumps([{**json.loads(path.read_text())[0], **change}]))
    about = json.loads(manifest.read_text())
    about["files"][path.name] = sha256(path.read_bytes()).hexdigest()
    manifest.write_text(json.dumps(about))
    with pytest.raises(FileError, match=fault):
        read_pack(folder)
