"""Looks of recordings of kitchens that are not shipped."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from tests.support.games import recorded_game

from robotouille import load_task
from robotouille.domain.rendering import rendering_of
from robotouille.installation import data_folder
from robotouille_client.window.replay.histories.recorded_history import open_shown


@pytest.fixture
def kitchen(tmp_path: Path) -> Path:
    """Folder with a kitchen that has its own name and rendering."""
    folder = tmp_path / "tasks"
    folder.mkdir()
    domain = json.loads((data_folder("domains") / "diner.json").read_text())
    problem = json.loads((data_folder("problems") / "examples/pancakes.json").read_text())
    domain.pop("rendering_json", None)
    (folder / "mine.json").write_text(json.dumps({**domain, "name": "mine"}))
    (folder / "crepes.json").write_text(json.dumps({**problem, "domain": "mine"}))
    shutil.copy(data_folder("renderings") / "diner.json", folder / "mine.rendering.json")
    return folder


@pytest.fixture
def recording(kitchen: Path, tmp_path: Path) -> Path:
    path = tmp_path / "recordings" / "game.rbt"
    path.parent.mkdir()
    path.write_bytes(recorded_game(str(kitchen / "crepes.json"), steps=2))
    return path


def looks_own(path: Path, tasks: Path | None = None) -> bool:
    return rendering_of(open_shown(path, tasks).task).assets == "diner"


def test_without_a_rendering_it_looks_like_the_kitchen(recording: Path) -> None:
    assert not looks_own(recording)
    assert not looks_own(recording, recording.parent)


def test_the_look_comes_from_the_given_or_the_current_folder(
    recording: Path, kitchen: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert looks_own(recording, kitchen)
    monkeypatch.chdir(kitchen)
    assert looks_own(recording)


def test_the_task_is_the_recorded_one(recording: Path, kitchen: Path) -> None:
    shown = open_shown(recording, kitchen)
    assert shown.task == load_task(str(kitchen / "crepes.json"))
    assert shown.verify().ok
