"""Cards of exports."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import yaml

from robotouille_data.database import CatalogueError
from robotouille_data.exports.documents import rewrite_card
from robotouille_data.exports.request import About
from tests.support.random_study import Write, manifest

ODD = 'A "kitchen": #1\n---\nlicense: mit'


def front_matter(folder: Path) -> dict[str, object]:
    _, matter, _ = (folder / "README.md").read_text().split("---\n", 2)
    found: dict[str, object] = yaml.safe_load(matter)
    return found


@pytest.mark.slow
def test_card_and_license_file_name_the_licence(write: Write) -> None:
    folder = write(about=About("Pairs", "Who waits?", "CC-BY-4.0", "lab@example.org"))
    assert front_matter(folder)["license"] == "cc-by-4.0"
    assert front_matter(folder)["pretty_name"] == "Pairs"
    text = (folder / "LICENSE").read_text()
    assert "SPDX-License-Identifier: CC-BY-4.0" in text
    assert "lab@example.org" in text
    assert "Who waits?" in (folder / "README.md").read_text()


def test_card_without_licence(write: Write) -> None:
    folder = write()
    assert front_matter(folder)["license"] == "other"
    assert "No licence was given" in (folder / "README.md").read_text()
    assert not (folder / "LICENSE").exists()


def test_card_can_be_rewritten(write: Write) -> None:
    folder = write()
    before, files = (folder / "README.md").read_text(), manifest(folder)["files"]
    assert rewrite_card(folder, {}) == before
    rewrite_card(folder, {"license": "CC0-1.0"})
    card = rewrite_card(folder, {"title": "Better"})
    assert card == (folder / "README.md").read_text() != before
    assert (front_matter(folder)["license"], front_matter(folder)["pretty_name"]) == (
        "cc0-1.0",
        "Better",
    )
    assert manifest(folder)["files"] == files


def test_text_cannot_break_the_front_matter(write: Write) -> None:
    folder = write(about=About(title=ODD, description=ODD))
    assert front_matter(folder)["pretty_name"] == ODD
    assert front_matter(folder)["license"] == "other"


def test_rewriting_a_card_refuses_other_folders_and_licences(tmp_path: Path, write: Write) -> None:
    with pytest.raises(CatalogueError, match="not an export"):
        rewrite_card(tmp_path, {})
    folder = write()
    with pytest.raises(CatalogueError, match="SPDX"):
        rewrite_card(folder, {"license": "free for all"})
    path = folder / "export.json"
    path.write_text(json.dumps({"about": {}}))
    with pytest.raises(CatalogueError, match="another version"):
        rewrite_card(folder, {})
    path.write_text("[]")
    with pytest.raises(CatalogueError, match="not an export"):
        rewrite_card(folder, {})
    path.write_text(f"[{'[],' * 3_000_000}[]]")
    with pytest.raises(CatalogueError, match="cannot be read"):
        rewrite_card(folder, {})


def test_query_cannot_break_a_line_of_the_card(write: Write) -> None:
    folder = write(labels={"condition": "a"}, query="SELECT id\n---\n, '`| \x1b[2J' FROM episodes")
    card = (folder / "README.md").read_text()
    assert "the query `SELECT id --- , ''/ \\u001b[2J' FROM episodes`" in card


@pytest.mark.slow
def test_card_shows_a_part_of_many_and_long_names(write: Write) -> None:
    folder = write()
    received = manifest(folder)
    received["labels"] = {f"l{number}\u202e\u200b": 1 for number in range(1000)}
    received["tasks"] = {"x" * 100_000: 1}
    received["recorded_by"] = {f"{number}.0": 1 for number in range(60)}
    (folder / "export.json").write_text(json.dumps(received))
    card = rewrite_card(folder, {})
    assert "`l49\\u202e\\u200b` (1 values) and 950 more." in card
    assert f"Tasks: `{'x' * 500}…` (1)." in card
    assert "49.0 (1) and 10 more, exported by" in card
    assert card.replace("\n", "").isprintable()


def test_unusual_version_is_quoted(write: Write) -> None:
    folder = write()
    received = manifest(folder)
    received["recorded_by"] = {"1 <script>`|\n---\n# Mine\x1b": 1, "0.1.0+local": 2}
    (folder / "export.json").write_text(json.dumps(received))
    card = rewrite_card(folder, {})
    assert "Recorded by Robotouille `1 <script>'/ --- # Mine\\u001b` (1), 0.1.0+local (2), " in card
