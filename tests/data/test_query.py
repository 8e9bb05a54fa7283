"""Queries read and nothing else, on both databases; answers are printed and saved."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille.domain.files import whole_file
from robotouille_data.answers.query import Answer, asking
from robotouille_data.answers.saving import save_csv, save_json, save_parquet, table_lines
from robotouille_data.database import database_url, insert, writing_engine
from robotouille_data.errors import CatalogueError, UnavailableError
from robotouille_data.schema import LABELS
from robotouille_data.versions import migrate

ROWS = [(number, "condition", f"c{number}") for number in range(2500)]
ALL = "SELECT * FROM labels ORDER BY episode_id"
WRITING = [
    "DELETE FROM labels",
    "INSERT INTO labels VALUES (1, 'a', 'b')",
    "UPDATE labels SET value = ''",
    "DROP TABLE labels",
    "CREATE TABLE more (x int)",
    "SELECT 1; DELETE FROM labels",
    "COMMIT; DELETE FROM labels",
    "WITH x AS (SELECT 1) INSERT INTO labels SELECT 1, 'a', 'b'",
    "BEGIN",
    "COMMIT",
    "VACUUM",
    "PRAGMA query_only = OFF",
    "PRAGMA journal_mode = DELETE",
    "ATTACH '/tmp/other.sqlite' AS other",
    "VACUUM INTO '/tmp/other.sqlite'",
    "SELECT load_extension('x')",
    "SET TRANSACTION READ WRITE",
    "SET default_transaction_read_only = off",
    "COPY labels TO '/tmp/labels'",
    "WITH gone AS (DELETE FROM labels RETURNING *) SELECT * FROM gone",
    "SELECT nextval('nothing')",
    "nonsense",
    "",
    " ; ",
]


@pytest.fixture
def filled(database: str) -> str:
    with writing_engine(database_url(database, Path())).begin() as connection:
        migrate(connection)
        insert(connection, LABELS, ROWS)
    return database


def ask(database: str, query: str, seconds: float = 60) -> list[tuple[Any, ...]]:
    with asking(database_url(database, Path()), query, seconds) as answer:
        return [tuple(row) for row in answer.rows]


def test_all_rows_come(filled: str) -> None:
    assert ask(filled, f"{ALL};") == ROWS


@pytest.mark.parametrize("query", WRITING)
def test_what_does_not_only_read_is_refused(filled: str, query: str) -> None:
    with pytest.raises(CatalogueError):
        ask(filled, query)
    assert ask(filled, ALL) == ROWS


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("SELECT episode FROM seats", ["no column `episode` in seats; there is one in episodes"]),
        ("SELECT episod_id FROM seats", ["`episod_id` in seats", "did you mean `episode_id`"]),
        ("SELECT s.waitng FROM episodes e JOIN seats AS s ON s.episode_id = e.id",
         ["no column `waitng` in seats", "did you mean `waiting`"]),
        ("SELECT stepz FROM episodes, measures", ["in episodes, measures", "did you mean `steps`"]),
        ("SELECT x.steps FROM seats s", ["no table of the query is called `x`; it has seats, s"]),
        ("SELECT condition FROM seats", ["`condition`", "labels are rows of the table labels"]),
        ("SELECT count(*) FROM seat", ["no table `seat`; did you mean `seats`. The tables: "]),
        ('SELECT steps FROM episodes WHERE "stepz" > 3', ["`stepz`", "did you mean `steps`"]),
        ('SELECT s."idel" FROM seats s', ["no column `idel` in seats", "did you mean `idle`"]),
        ('SELECT "condition" FROM seats', ["`condition`", "labels are rows of the table labels"]),
        ("SELECT * FROM zzzz", ["no table `zzzz`. The tables: "]),
    ],
)  # fmt: skip
def test_unknown_names_are_told_with_the_nearest(filled: str, query: str, told: list[str]) -> None:
    with pytest.raises(CatalogueError) as error:
        ask(filled, query)
    for words in told:
        assert words in str(error.value)
    assert "LINE" not in str(error.value)


def test_names_in_double_quotes_are_names_and_texts_stay_texts(filled: str) -> None:
    query = (
        'SELECT "value" AS "a ""b` c", \'x "y" \'\'z\'\'\' AS text -- "nothing" \'in\' here\n'
        'FROM "labels" /* "nor here" */ WHERE "episode_id" = 7'
    )
    with asking(database_url(filled, Path()), query) as answer:
        assert answer.columns == ('a "b` c', "text")
        assert [tuple(row) for row in answer.rows] == [("c7", "x \"y\" 'z'")]


@pytest.mark.parametrize("query", ["DELETE FROM labels", "PRAGMA query_only = OFF"])
def test_what_writes_is_told_that_a_query_only_reads(tmp_path: Path, query: str) -> None:
    database = str(tmp_path / "catalogue.sqlite")
    with writing_engine(database_url(database, Path())).begin() as connection:
        migrate(connection)
    with pytest.raises(CatalogueError, match="a query only reads"):
        ask(database, query)


def test_time_is_limited(filled: str) -> None:
    endless = (
        "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x % 9 + 1 FROM n) SELECT sum(x) FROM n"
    )
    with pytest.raises(UnavailableError, match=r"interrupted|timeout"):
        ask(filled, endless, seconds=0.2)


def test_columns_that_are_called_alike_have_numbers(filled: str) -> None:
    with asking(database_url(filled, Path()), "SELECT 1 AS a, 2 AS a, 3 AS b") as answer:
        assert answer.columns == ("a", "a_2", "b")


def test_a_catalogue_in_a_folder_that_cannot_be_written_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database = str(tmp_path / "catalogue.sqlite")
    with writing_engine(database_url(database, Path())).begin() as connection:
        migrate(connection)
        insert(connection, LABELS, ROWS)
    before = sorted(tmp_path.iterdir())
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    assert ask(database, ALL) == ROWS
    assert sorted(tmp_path.iterdir()) == before


def test_no_catalogue_is_told(tmp_path: Path) -> None:
    with pytest.raises(CatalogueError, match="there is no catalogue"):
        ask(str(tmp_path / "none.sqlite"), "SELECT 1")
    (tmp_path / "text.sqlite").write_text("something else, which is no database")
    with pytest.raises(CatalogueError):
        ask(str(tmp_path / "text.sqlite"), "SELECT 1")
    assert not (tmp_path / "none.sqlite").exists()


def test_a_table_shows_no_control_characters(filled: str) -> None:
    query = "SELECT 'a' || chr(27) || '[2J' AS x, NULL AS y, 0.5 AS z"
    if filled.startswith("/"):
        query = query.replace("chr", "char")
    with asking(database_url(filled, Path()), query) as answer:
        lines, more = table_lines(answer)
    assert lines == ["x      y  z", "-----  -  ---", "a\ufffd[2J     0.5"]
    assert not more
    with asking(database_url(filled, Path()), ALL) as answer:
        lines, more = table_lines(answer, limit=3)
    assert len(lines) == 5
    assert more


def test_files_hold_the_same(filled: str, tmp_path: Path) -> None:
    def saved(save: Any, name: str) -> Path:
        with asking(database_url(filled, Path()), ALL) as answer:
            assert save(answer, tmp_path / name) == len(ROWS)
        return tmp_path / name

    with saved(save_csv, "a.csv").open(newline="") as file:
        heading, *rows = csv.reader(file)
    assert heading == ["episode_id", "name", "value"]
    assert rows == [[str(number), name, value] for number, name, value in ROWS]
    found = json.loads(saved(save_json, "a.json").read_text())
    assert [tuple(row.values()) for row in found] == ROWS
    polars = pytest.importorskip("polars", reason="needs the extra `data`")
    assert polars.read_parquet(saved(save_parquet, "a.parquet")).rows() == ROWS


def test_an_empty_answer_has_its_columns(filled: str, tmp_path: Path) -> None:
    query = "SELECT name FROM labels WHERE name = 'x'"
    for save, name in ((save_csv, "a.csv"), (save_json, "a.json")):
        with asking(database_url(filled, Path()), query) as answer:
            assert save(answer, tmp_path / name) == 0
    assert (tmp_path / "a.csv").read_text() == "name\n"
    assert json.loads((tmp_path / "a.json").read_text()) == []


def test_a_file_that_cannot_be_written_is_as_before(filled: str, tmp_path: Path) -> None:
    with (
        asking(database_url(filled, Path()), ALL) as answer,
        pytest.raises(FileNotFoundError),
    ):
        save_csv(answer, tmp_path / "nowhere" / "a.csv")


def test_what_lies_beside_a_file_stays(tmp_path: Path) -> None:
    mine = tmp_path / "a.csv.tmp"
    mine.write_text("mine")
    with whole_file(tmp_path / "a.csv") as file:
        file.write("x")
    assert mine.read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", "a.csv.tmp"}


def test_endless_numbers_are_null_in_json(tmp_path: Path) -> None:
    answer = Answer(("a", "b", "c"), iter([(float("inf"), float("nan"), 1.5)]))
    assert save_json(answer, tmp_path / "a.json") == 1
    (row,) = json.loads((tmp_path / "a.json").read_text())
    assert row == {"a": None, "b": None, "c": 1.5}
