"""Read-only queries on both kinds of database, and output of their answers."""

from __future__ import annotations

import csv
import json
import os
import shutil
import sys
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille_data.database import (
    CatalogueError,
    UnavailableError,
    database_url,
    insert,
    migrate,
    writing_engine,
)
from robotouille_data.query import QueryAnswer, asking
from robotouille_data.query_output import save_csv, save_json, save_parquet, table_lines
from robotouille_data.schema import LABELS

ROWS = [(number, "condition", f"c{number}") for number in range(2500)]
ALL = "SELECT * FROM labels ORDER BY episode_id"
WRITING = [
    "DELETE FROM labels", "INSERT INTO labels VALUES (1, 'a', 'b')", "UPDATE labels SET value = ''",
    "DROP TABLE labels", "CREATE TABLE more (x int)", "SELECT 1; DELETE FROM labels",
    "COMMIT; DELETE FROM labels", "WITH x AS (SELECT 1) INSERT INTO labels SELECT 1, 'a', 'b'",
    "BEGIN", "COMMIT", "VACUUM", "PRAGMA query_only = OFF", "PRAGMA journal_mode = DELETE",
    "ATTACH '/tmp/other.sqlite' AS other", "VACUUM INTO '/tmp/other.sqlite'",
    "SELECT load_extension('x')", "SET TRANSACTION READ WRITE",
    "SET default_transaction_read_only = off", "COPY labels TO '/tmp/labels'",
    "WITH gone AS (DELETE FROM labels RETURNING *) SELECT * FROM gone",
    "SELECT nextval('nothing')", "nonsense", "", " ; ",
]  # fmt: skip


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a filled SQLite catalogue to copy."""
    path = tmp_path_factory.mktemp("template") / "catalogue.sqlite"
    fill(str(path))
    return path


@pytest.fixture
def filled(database: str, template: Path) -> str:
    if "://" in database:
        fill(database)
    else:
        shutil.copyfile(template, database)
    return database


def fill(database: str) -> None:
    with writing_engine(database_url(database, Path())).begin() as connection:
        migrate(connection)
        insert(connection, LABELS, ROWS)


def ask(database: str, query: str, seconds: float = 60) -> list[tuple[Any, ...]]:
    with asking(database_url(database, Path()), query, seconds) as answer:
        return [tuple(row) for row in answer.rows]


def test_query_returns_all_rows(filled: str) -> None:
    assert ask(filled, f"{ALL};") == ROWS


@pytest.mark.parametrize("query", WRITING)
def test_statements_other_than_queries_are_refused(filled: str, query: str) -> None:
    with pytest.raises(CatalogueError):
        ask(filled, query)
    assert ask(filled, ALL) == ROWS


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("SELECT episode FROM seats", ["no column `episode` in seats; it is in episodes"]),
        ("SELECT episod_id FROM seats", ["`episod_id` in seats", "did you mean `episode_id`"]),
        ("SELECT s.waitng FROM episodes e JOIN seats AS s ON s.episode_id = e.id",
         ["no column `waitng` in seats", "did you mean `waiting`"]),
        ("SELECT stepz FROM episodes, measures", ["in episodes, measures", "did you mean `steps`"]),
        ("SELECT x.steps FROM seats s", ["the query has no table `x`; it has seats, s"]),
        ("SELECT condition FROM seats", ["`condition`", "labels are rows of the table labels"]),
        ("SELECT count(*) FROM seat", ["no table `seat`; did you mean `seats`. The tables: "]),
        ('SELECT steps FROM episodes WHERE "stepz" > 3', ["`stepz`", "did you mean `steps`"]),
        ('SELECT s."idel" FROM seats s', ["no column `idel` in seats", "did you mean `idle`"]),
        ('SELECT "condition" FROM seats', ["`condition`", "labels are rows of the table labels"]),
        ("SELECT * FROM zzzz", ["no table `zzzz`. The tables: "]),
    ],
)  # fmt: skip
def test_unknown_names_get_a_suggestion(filled: str, query: str, expected: list[str]) -> None:
    with pytest.raises(CatalogueError) as error:
        ask(filled, query)
    for words in expected:
        assert words in str(error.value)
    assert "LINE" not in str(error.value)


def test_double_quotes_delimit_names_and_never_strings(filled: str) -> None:
    query = (
        'SELECT "value" AS "a ""b` c", \'x "y" \'\'z\'\'\' AS text -- "nothing" \'in\' here\n'
        'FROM "labels" /* "nor here" */ WHERE "episode_id" = 7'
    )
    with asking(database_url(filled, Path()), query) as answer:
        assert answer.columns == ('a "b` c', "text")
        assert [tuple(row) for row in answer.rows] == [("c7", "x \"y\" 'z'")]


ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x % 9 + 1 FROM n) SELECT sum(x) FROM n"
# Each call compares millions of bytes at millions of places, in one instruction of SQLite.
LONG_CALL = (
    "SELECT instr(a, substr(a, 1, 9000000) || 'b') FROM (SELECT hex(zeroblob(9000000)) AS a)"
)
# The second thousand of rows is fetched by a statement that begins without the server's limit.
WITHOUT_LIMIT = """
    SELECT set_config('statement_timeout', '0', false) FROM generate_series(1, 2000) n
    WHERE n <= 1000 OR pg_sleep(1000) IS NOT NULL
"""


@pytest.mark.process
@pytest.mark.parametrize(
    ("database", "query"),
    [
        ("sqlite", ENDLESS),
        ("sqlite", LONG_CALL),
        ("postgresql", ENDLESS),
        ("postgresql", WITHOUT_LIMIT),
    ],
    indirect=["database"],
)
def test_query_has_a_time_limit(filled: str, query: str) -> None:
    with pytest.raises(UnavailableError, match=r"interrupted: the query takes longer than 0\.5 s"):
        ask(filled, query, seconds=0.5)


@pytest.mark.process
class TestSqliteProcess:
    """Queries of SQLite in a process of their own, as users run them."""

    @pytest.fixture
    def database(self, tmp_path: Path) -> str:
        return str(tmp_path / "catalogue.sqlite")

    def test_process_returns_all_rows(self, filled: str) -> None:
        assert ask(filled, f"{ALL};") == ROWS
        values = "SELECT 9223372036854775807, -0.5, NULL, 'é', x'00ff', 9e999"
        assert ask(filled, values) == [(2**63 - 1, -0.5, None, "é", b"\x00\xff", float("inf"))]

    def test_reader_may_stop_early(self, filled: str) -> None:
        with asking(database_url(filled, Path()), ALL) as answer:
            assert tuple(next(answer.rows)) == ROWS[0]

    @pytest.mark.parametrize("query", ["DELETE FROM labels", "SELECT 1; SELECT 2", "SELECT x", ""])
    def test_errors_are_those_of_the_query(self, filled: str, query: str) -> None:
        with pytest.raises(CatalogueError) as error:
            ask(filled, query)
        assert not isinstance(error.value, UnavailableError)

    def test_large_values_are_refused(self, filled: str) -> None:
        with pytest.raises(CatalogueError, match="too big"):
            ask(filled, "SELECT length(hex(zeroblob(1000000000)))")

    @pytest.mark.skipif(sys.platform != "linux", reason="no limit of memory")
    def test_memory_is_limited(self, filled: str) -> None:
        wide = ", ".join(["zeroblob(60000000)"] * 30)
        with pytest.raises(UnavailableError, match="memory"):
            ask(filled, f"SELECT {wide}")


@pytest.mark.process
@pytest.mark.parametrize("database", ["postgresql"], indirect=True)
def test_superuser_cannot_query(filled: str) -> None:
    with pytest.raises(CatalogueError, match="superuser"):
        ask(filled.replace("//owner@", "//postgres@"), "SELECT 1")


def test_repeated_column_names_get_numbers(filled: str) -> None:
    with asking(database_url(filled, Path()), "SELECT 1 AS a, 2 AS a, 3 AS b") as answer:
        assert answer.columns == ("a", "a_2", "b")


def test_catalogue_in_a_read_only_folder_can_be_read(
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


def test_missing_catalogue_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CatalogueError, match="no catalogue"):
        ask(str(tmp_path / "none.sqlite"), "SELECT 1")
    (tmp_path / "text.sqlite").write_text("something else, which is no database")
    with pytest.raises(CatalogueError):
        ask(str(tmp_path / "text.sqlite"), "SELECT 1")
    assert not (tmp_path / "none.sqlite").exists()


def test_table_replaces_control_characters_and_limits_rows(filled: str) -> None:
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


@pytest.mark.slow
def test_csv_json_and_parquet_contain_all_rows(filled: str, tmp_path: Path) -> None:
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


def test_carriage_return_in_a_csv_cell_begins_no_row(tmp_path: Path) -> None:
    rows = [("a\r=1+1\rb", 1), ("c\r\nd", 2)]
    save_csv(QueryAnswer(("text", "number"), iter(rows)), tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as file:
        assert list(csv.reader(file))[1:] == [["a\n=1+1\nb", "1"], ["c\nd", "2"]]


def test_csv_marks_texts_that_look_like_formulas(tmp_path: Path) -> None:
    rows = [("=1+1", -1), ("\t@x", 2), (" -3", None), ("a=b", 4.5)]
    assert save_csv(QueryAnswer(("+a", "b"), iter(rows)), tmp_path / "a.csv") == len(rows)
    with (tmp_path / "a.csv").open(newline="") as file:
        found = list(csv.reader(file))
    assert found == [["'+a", "b"], ["'=1+1", "-1"], ["'\t@x", "2"], ["' -3", ""], ["a=b", "4.5"]]


def test_decimals_are_plain_numbers(tmp_path: Path) -> None:
    written = ("0E-20", "335.0000000000000000", "1E+3", "-1E-8", "12345678901234567890123456789.10")
    shown = ["0", "335", "1000", "-0.00000001", "12345678901234567890123456789.1"]
    rows = [(Decimal(text),) for text in written]
    assert table_lines(QueryAnswer(("a",), iter(rows)))[0][2:] == shown
    save_csv(QueryAnswer(("a",), iter(rows)), tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().splitlines()[1:] == shown


def test_empty_answer_keeps_its_columns(filled: str, tmp_path: Path) -> None:
    query = "SELECT name FROM labels WHERE name = 'x'"
    for save, name in ((save_csv, "a.csv"), (save_json, "a.json")):
        with asking(database_url(filled, Path()), query) as answer:
            assert save(answer, tmp_path / name) == 0
    assert (tmp_path / "a.csv").read_text() == "name\n"
    assert json.loads((tmp_path / "a.json").read_text()) == []


def test_infinite_numbers_are_null_in_json(tmp_path: Path) -> None:
    answer = QueryAnswer(("a", "b", "c"), iter([(float("inf"), float("nan"), 1.5)]))
    assert save_json(answer, tmp_path / "a.json") == 1
    (row,) = json.loads((tmp_path / "a.json").read_text())
    assert row == {"a": None, "b": None, "c": 1.5}
