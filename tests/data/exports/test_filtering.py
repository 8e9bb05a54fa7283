"""Which episodes are exported, and why the others are not."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl
from sqlalchemy.engine import URL

from robotouille_data.errors import CatalogueError
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import ExportFormat, Request
from tests.support.random_study import PAIRS, ROUNDS, Write, manifest


def labels(folder: Path) -> list[tuple[str, str]]:
    frame = pl.read_parquet(folder / "labels.parquet")
    return sorted(set(frame.select("name", "value").rows()))


def test_all_episodes_are_there(write: Write) -> None:
    assert manifest(write())["episodes"] == PAIRS * ROUNDS


@pytest.mark.parametrize("column", ["id", "id AS episode_id"])
def test_a_query_names_episodes(write: Write, column: str) -> None:
    query = f"SELECT steps, {column} FROM episodes WHERE episode IN ('random0', 'random3')"
    folder = write(query=query)
    assert set(pl.read_parquet(folder / "episodes.parquet")["episode"]) == {"random0", "random3"}
    assert manifest(folder)["query"] == query


def test_ids_may_come_more_than_once_and_be_unknown(write: Write) -> None:
    query = "SELECT episode_id FROM seats UNION ALL SELECT 7 UNION ALL SELECT NULL"
    found = manifest(write(query=query))
    assert (found["episodes"], found["left_out"]) == (PAIRS * ROUNDS, {"unknown": 1})


def test_labels_are_all_asked_for(write: Write) -> None:
    folder = write(labels={"condition": "a", "pair": "pair1"})
    assert labels(folder) == [("condition", "a"), ("consent", "yes"), ("pair", "pair1")]
    assert manifest(folder)["left_out"] == {"label": PAIRS * ROUNDS - 1}


def test_who_has_not_consented_is_left_out_and_counted(write: Write) -> None:
    folder = write(consent=("consent", "yes"))
    assert ("consent", "no") not in labels(folder)
    assert manifest(folder)["left_out"] == {"consent": ROUNDS}
    assert f"{ROUNDS} episodes without the label of consent" in (folder / "README.md").read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"query": "SELECT steps FROM episodes"}, "has no column"),
        ({"query": "SELECT episode AS id FROM episodes"}, "is no id"),
        ({"query": "DELETE FROM episodes"}, "a query only reads"),
        ({"labels": {"condition": "c"}}, "no episode has the label condition=c; "),
        ({"split": {"train": 1.0, "test": 1.0}, "split_by": "condition"}, "nothing is left for"),
    ],
)
def test_what_cannot_be_exported_leaves_nothing(
    url: URL, tmp_path: Path, options: dict[str, object], words: str
) -> None:
    request = Request((ExportFormat.CSV,), **options)  # type: ignore[arg-type]
    with pytest.raises(CatalogueError, match=words):
        export(url, tmp_path / "out", request)
    assert not list(tmp_path.iterdir())
