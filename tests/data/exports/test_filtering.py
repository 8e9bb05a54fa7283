"""Selection of the exported episodes."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl
from sqlalchemy.engine import URL

from robotouille_data.database import CatalogueError
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import ExportFormat, ExportRequest
from tests.support.random_study import PAIRS, ROUNDS, Write, manifest


def labels(folder: Path) -> list[tuple[str, str]]:
    frame = pl.read_parquet(folder / "labels.parquet")
    return sorted(set(frame.select("name", "value").rows()))


def test_default_export_contains_all_episodes(write: Write) -> None:
    assert manifest(write())["episodes"] == PAIRS * ROUNDS


@pytest.mark.parametrize("column", ["id", "id AS episode_id"])
def test_query_selects_episodes(write: Write, column: str) -> None:
    query = f"SELECT steps, {column} FROM episodes WHERE episode IN ('random0', 'random3')"
    folder = write(query=query)
    assert set(pl.read_parquet(folder / "episodes.parquet")["episode"]) == {"random0", "random3"}
    assert manifest(folder)["query"] == query


def test_repeated_and_unknown_ids_are_handled(write: Write) -> None:
    query = "SELECT episode_id FROM seats UNION ALL SELECT 7 UNION ALL SELECT NULL"
    found = manifest(write(query=query))
    assert (found["episodes"], found["left_out"]) == (PAIRS * ROUNDS, {"unknown": 1})


def test_episodes_must_have_all_labels(write: Write) -> None:
    folder = write(labels={"condition": "a", "pair": "pair1"})
    assert labels(folder) == [("condition", "a"), ("consent", "yes"), ("pair", "pair1")]
    assert manifest(folder)["left_out"] == {"label": PAIRS * ROUNDS - 1}


def test_episodes_without_consent_are_left_out_and_counted(write: Write) -> None:
    folder = write(consent=("consent", "yes"))
    assert ("consent", "no") not in labels(folder)
    assert manifest(folder)["left_out"] == {"consent": ROUNDS}
    assert f"{ROUNDS} episodes without the label of consent" in (folder / "README.md").read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"query": "SELECT steps FROM episodes"}, "has no column"),
        ({"query": "SELECT episode AS id FROM episodes"}, "is not an episode id"),
        ({"query": "DELETE FROM episodes"}, "queries are read-only"),
        ({"labels": {"condition": "c"}}, "no episode has the label condition=c; "),
        ({"split": {"train": 1.0, "test": 1.0}, "split_by": "condition"}, "no episodes for"),
    ],
)
def test_failed_export_leaves_nothing(
    url: URL, tmp_path: Path, options: dict[str, object], words: str
) -> None:
    request = ExportRequest((ExportFormat.CSV,), **options)  # type: ignore[arg-type]
    with pytest.raises(CatalogueError, match=words):
        export(url, tmp_path / "out", request)
    assert not list(tmp_path.iterdir())
