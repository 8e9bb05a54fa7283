"""Commands check where they are to write before they read, play or search."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from robotouille_client.cli.main import app

# No recording, table or server of these commands exists, so errors about them would come later.
FILES = [
    ("--out", "replay export no.rbt --out {}/x.jsonl"),
    ("OUTPUT", "replay page no.rbt {}/x.html"),
    ("OUTPUT", "replay video no.rbt {}/x.mp4"),
    ("--screenshot", "replay play no.rbt --screenshot {}/x.png"),
    ("--screenshot", "play synchronous/01 --screenshot {}/x.png"),
    ("--out", "plan synchronous/01 --out {}/x.plan"),
    ("--out", "cross-play training/03@2 no.npz --out {}/x.csv"),
    ("--out", "data report --folder no --out {}/x.html"),
    ("--csv", "data sql nonsense --folder no --csv {}/x.csv"),
    ("--out", "episodes open no.csv --out {}/x.csv"),
    ("--out", "episodes list --url ws://127.0.0.1:9 --out {}/x.csv"),
]


def output_of(words: str) -> str:
    result = CliRunner().invoke(app, words.split())
    assert result.exit_code != 0
    return result.output.replace("\n", "")


@pytest.mark.parametrize(("option", "words"), FILES, ids=[words for _, words in FILES])
def test_missing_folder_is_named_before_the_work(
    option: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert output_of(words.format("nowhere")) == f"{option}: no folder nowhere; create it first"
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("words", ["generate synchronous/01 --out {}", "pddl soop --out {}"])
def test_file_in_place_of_a_folder_is_named_before_the_work(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").touch()
    found = output_of(words.format("taken/inside"))
    assert found == f"--out: {tmp_path / 'taken'} is a file; expected a folder"
