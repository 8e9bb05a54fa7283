"""Drafts: what a killed process has left is deleted, and nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from robotouille.files.drafts import draft_of, drafted, drafted_folder
from robotouille.files.writing import replace_file, whole_file

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs locks and links")

KILLED = """
import os, sys
from pathlib import Path
from robotouille.files.writing import whole_file
with whole_file(Path(sys.argv[1])) as file:
    file.write("half")
    file.flush()
    os.kill(os.getpid(), 9)
"""


@pytest.mark.process
def test_killed_processes_leave_one_draft_until_the_file_is_written(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", KILLED, str(path)])
        assert done.returncode == -signal.SIGKILL
        assert len(list(tmp_path.iterdir())) == 1
    replace_file(path, "whole")
    assert list(tmp_path.iterdir()) == [path]


def test_draft_in_use_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "x"
    with drafted(path) as one, drafted(path) as other:
        assert one != other
        assert draft_of(path) not in (one, other)
    assert list(tmp_path.iterdir()) == [path]


def test_abandoned_folder_is_deleted_without_following_links(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "file").touch()
    left = draft_of(tmp_path / "export", "part")
    left.mkdir()
    (left / "link").symlink_to(precious)
    with drafted_folder(tmp_path / "export") as draft:
        assert not list(draft.iterdir())
        with drafted_folder(tmp_path / "export") as other:
            assert other != draft
    assert list(tmp_path.iterdir()) == [precious]
    assert list(precious.iterdir())


def test_draft_with_the_name_of_an_earlier_one_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another program can take the name as soon as the earlier draft is renamed."""
    path, replace, others = tmp_path / "x", Path.replace, ExitStack()

    def then_begin_another(draft: Path, target: Path) -> Path:
        replaced = replace(draft, target)
        assert others.enter_context(drafted(path)) == draft
        return replaced

    with others, monkeypatch.context() as patched:
        patched.setattr(Path, "replace", then_begin_another)
        replace_file(path, "one")
        patched.undo()
        with drafted_folder(tmp_path / "export") as folder:
            folder.rename(tmp_path / "export")
            assert others.enter_context(drafted_folder(tmp_path / "export")) == folder
        assert folder.is_dir()
    assert sorted(tmp_path.iterdir()) == [tmp_path / "export", path]


def test_planted_links_and_pipes_are_left_alone(tmp_path: Path) -> None:
    path, precious = tmp_path / "x", tmp_path / "precious"
    precious.write_text("precious")
    planted = [draft_of(path)]
    planted[0].symlink_to(precious)
    planted.append(draft_of(path))
    os.mkfifo(planted[1])
    replace_file(path, "new")
    assert sorted(tmp_path.iterdir()) == sorted([path, precious, *planted])
    assert (path.read_text(), precious.read_text()) == ("new", "precious")


def test_new_file_replaces_no_other(tmp_path: Path) -> None:
    path = tmp_path / "x"
    with pytest.raises(FileExistsError), drafted(path, replace=False):
        path.write_text("earlier")
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder_is_an_error(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError, match=r"/x'"), whole_file(tmp_path / "x"):
        pass
    tmp_path.chmod(0o700)


def test_long_name_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="name too long"), whole_file(tmp_path / ("x" * 250)):
        pass
