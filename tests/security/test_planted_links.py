"""Files in folders from other people: links there never make a command change another file."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("matplotlib", reason="needs the extra `bench`")
pytest.importorskip("pyarrow", reason="needs the extra `bench`")
pytest.importorskip("av", reason="needs the extra `video`")

from robotouille.errors import FileError
from robotouille.files.writing import whole_file
from robotouille.replay.compression import compress
from robotouille_client.cli.main import app
from robotouille_evaluation.models import Completion, Message, ModelRequest, Usage
from robotouille_evaluation.report import write_report
from robotouille_evaluation.runs import RunFolder
from robotouille_evaluation.runs.journal import CallJournal
from tests.support.episode_rows import row
from tests.support.games import recorded_game
from tests.support.samples import quick_sample
from tests.support.sqlite_answers import answers_without_processes

__all__ = ["answers_without_processes"]

PRECIOUS = "precious, without a line end"
TASK = "synchronous/01_cheese_sandwich"
COMMANDS = [
    ("data sql VALUES(1) --folder {} --csv {}/x.csv", "x.csv"),
    ("replay export {}/a.rbt --out {}/x.jsonl", "x.jsonl"),
    ("replay video {}/a.rbt {}/x.gif --size 160x120", "x.gif"),
    ("replay play {}/a.rbt --screenshot {}/x.png --size 320x240", "x.png"),
    ("play synchronous/01 --screenshot {}/x.jpg --size 320x240", "x.jpg"),
    ("pddl synchronous/01 --out {}", "domain.pddl"),
    ("data report --folder {} --out {}/report.html", "report.html"),
    ("replay page {}/a.rbt {}/x.html", "x.html"),
]


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    path = tmp_path / "precious"
    path.write_text(PRECIOUS)
    return path


def plant(path: Path, target: Path) -> None:
    """Replace a file, and the drafts that this and earlier versions write for it, by links."""
    drafts = (
        *(f".{path.name}.{middle}tmp" for middle in ("", "0.", "1.")),
        f"{path.stem}.part{path.suffix}",
        f"{path.stem}.new",
    )
    for link in (path, *map(path.with_name, drafts)):
        link.unlink(missing_ok=True)
        link.symlink_to(target)


@pytest.mark.parametrize(
    ("words", "output"), quick_sample(COMMANDS, 6), ids=[name for _, name in COMMANDS]
)
def test_commands_replace_links(words: str, output: str, tmp_path: Path, precious: Path) -> None:
    folder = tmp_path / "received"
    folder.mkdir()
    (folder / "a.rbt").write_bytes(compress(recorded_game(TASK, steps=3)))
    assert CliRunner().invoke(app, ["data", "index", str(folder)]).exit_code == 0
    plant(folder / output, precious)
    result = CliRunner().invoke(app, words.replace("{}", str(folder)).split())
    assert result.exit_code == 0, result.output
    assert precious.read_text() == PRECIOUS
    assert not (folder / output).is_symlink()
    assert (folder / output).stat().st_size


@pytest.mark.slow
def test_reports_replace_links(tmp_path: Path, precious: Path) -> None:
    rows = [row()]
    folder = tmp_path / "report"
    write_report(rows, folder, graphs=())
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    for path in files:
        plant(path, precious)
    write_report(rows, folder, graphs=())
    assert precious.read_text() == PRECIOUS
    assert len(files) > 5
    assert not [path for path in files if path.is_symlink()]


def test_runs_change_no_file_behind_links(tmp_path: Path, precious: Path) -> None:
    run = RunFolder(tmp_path / "run")
    for name in ("rows.jsonl", "recordings/x.rbt"):
        (run.path / name).parent.mkdir(parents=True, exist_ok=True)
        plant(run.path / name, precious)
    run.write(run.path / "recordings/x.rbt", b"recording")
    with pytest.raises(FileError, match=r"rows\.jsonl: it is a symbolic link"), run.playing():
        pass
    with pytest.raises(FileError, match=r"rows\.jsonl: cannot be written: it is a symbolic link"):
        run.add(row())
    assert precious.read_text() == PRECIOUS


def test_journals_change_no_file_behind_links(tmp_path: Path, precious: Path) -> None:
    (tmp_path / "calls.jsonl").symlink_to(precious)
    precious.write_text("")
    with (
        CallJournal(tmp_path / "calls.jsonl") as journal,
        pytest.raises(FileError, match="it is a symbolic link"),
    ):
        journal.keep(ModelRequest((Message("user", "?"),)), Completion("wait", Usage()))
    assert not precious.read_text()


def test_a_catalogue_is_no_link_unless_named(tmp_path: Path) -> None:
    folder, other = tmp_path / "received", tmp_path / "other.sqlite"
    folder.mkdir()
    other.touch()
    (folder / "catalogue.sqlite").symlink_to(other)
    result = CliRunner().invoke(app, ["data", "index", str(folder)])
    assert result.exit_code == 1
    assert "catalogue.sqlite: it is a symbolic link" in result.output.replace("\n", "")
    assert not other.stat().st_size
    named = ["data", "index", str(folder), "--database", str(folder / "catalogue.sqlite")]
    assert CliRunner().invoke(app, named).exit_code == 0
    assert other.stat().st_size


def test_the_last_of_two_writers_wins(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    with whole_file(path) as late:
        late.write("late\n")
        with whole_file(path) as early:
            early.write("early\n" * 3)
        assert path.read_text() == "early\n" * 3
        late.write("late\n")
    assert path.read_text() == "late\n" * 2
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX permissions")
def test_new_files_follow_the_umask_and_private_ones_stay_private(tmp_path: Path) -> None:
    modes = []
    before = os.umask(0o027)
    try:
        for mode in (None, 0o600, 0o644):
            path = tmp_path / str(mode)
            if mode is not None:
                path.touch()
                path.chmod(mode)
            with whole_file(path) as file:
                file.write("x")
            modes.append(path.stat().st_mode & 0o777)
    finally:
        os.umask(before)
    assert modes == [0o640, 0o600, 0o640]
