"""docs/data.md describes all tables, and its queries and commands work."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from typer.testing import CliRunner

from robotouille.replay import read_recording
from robotouille.replay.compression import compress
from robotouille_client.cli.main import app
from robotouille_data.database import database_url
from robotouille_data.indexing import index
from robotouille_data.query import asking
from robotouille_data.recorded_seats import ACTIVITIES
from robotouille_data.schema import EPISODE_SEATS, METADATA, VIEWS
from tests.support.pages import blocks, read
from tests.support.random_play import random_stream, write_recordings
from tests.support.sqlite_answers import answers_without_processes

__all__ = ["answers_without_processes"]

PAGE = read("data.md")
QUERIES = re.findall(r"```sql\n(.*?)```", PAGE, re.DOTALL)


def test_every_column_is_described() -> None:
    described = {
        name: re.findall(
            r"^\| `(\w+)` \|", PAGE.partition(f"### {name}\n")[2].partition("\n#")[0], re.M
        )
        for name in {*METADATA.tables, *VIEWS.tables}
    }
    for name, table in METADATA.tables.items():
        assert described[name] == table.columns.keys()
    assert {*described["episode_seats"], *described["seats"]} == {*EPISODE_SEATS.columns.keys()}
    assert all(column.doc for table in METADATA.tables.values() for column in table.columns)


def test_every_activity_is_described() -> None:
    section = PAGE.partition("## Activities")[2].partition("\n##")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)) == {*ACTIVITIES, "activity"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("recordings")
    write_recordings(found, 4)
    index(database_url(None, found), [found])
    return found


def test_the_view_matches_the_schema_and_the_tables(folder: Path) -> None:
    its = VIEWS.tables["episode_seats"].columns.keys()
    with asking(database_url(None, folder), "SELECT * FROM episode_seats") as answer:
        assert list(answer.columns) == its
        rows = [dict(zip(its, row, strict=True)) for row in answer.rows]
    query = """SELECT s.*, e.steps AS all_steps, m.success AS won FROM seats s
               JOIN episodes e ON e.id = s.episode_id JOIN measures m USING (episode_id)"""
    with asking(database_url(None, folder), query) as answer:
        others = [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]
    key = ("episode_id", "seat")
    for row, other in zip(
        sorted(rows, key=lambda r: [r[k] for k in key]),
        sorted(others, key=lambda r: [r[k] for k in key]),
        strict=True,
    ):
        assert (row["steps"], row["success"]) == (other.pop("all_steps"), other.pop("won"))
        assert {name: row[name] for name in other} == other


@pytest.mark.parametrize("query", QUERIES)
def test_queries_return_rows(folder: Path, query: str) -> None:
    with asking(database_url(None, folder), query) as answer:
        assert list(answer.rows)


def test_the_query_for_seats_matches_recordings(folder: Path) -> None:
    """Compare rejections, chat and decision time; activities have their own tests."""
    with asking(database_url(None, folder), QUERIES[0]) as answer:
        rows = [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]
    assert len(rows) == 8
    for row in rows:
        recording = read_recording(folder / f"{row['episode']}.rbt")
        outcome, player = recording.outcome, recording.world.players[row["seat"]]
        assert outcome is not None
        assert (row["reason"], row["steps"]) == (outcome["reason"], outcome["steps"])
        tally = {seat["player"]: seat for seat in outcome["seats"]}[player]
        assert row["said"] == tally["said"]
        asked = Counter(note["note"] for note in recording.notes() if note.get("player") == player)
        moves = [
            (move["seq"] > 0, str(i) in frame.get("unmet", {}), move["ms"])
            for frame in recording.steps
            for i, move in enumerate(frame["moves"])
            if move["player"] == player
        ]
        lost = sum(own and gone for own, gone, _ in moves)
        assert row["rejected"] == asked["rejected"] + lost
        times = [ms for own, gone, ms in moves if own and not gone]
        if row["acted"] == len(
            times
        ):  # False if an action was applied after its connection was lost.
            assert row["decision_ms"] == pytest.approx(sum(times) / len(times))


@pytest.mark.slow
def test_export_commands_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the commands in order, then the code that reads the arrays."""
    np = pytest.importorskip("numpy", reason="needs the extra `rl`")
    pytest.importorskip("pyarrow", reason="needs the extra `data`")
    monkeypatch.chdir(tmp_path)
    Path("recordings").mkdir()
    for seed in (1, 3, 6):  # These seeds have the same timing, and so the same task.
        people = [(f"{name}{seed}", f"{name}{seed}") for name in ("ada", "bob")]
        stream = random_stream(seed, people=people)
        Path(f"recordings/{seed}.rbt").write_bytes(compress(stream))
    section = PAGE.partition("\n## Exports\n")[2].partition("\n## ")[0]
    commands = re.findall(r"^\$ robotouille (.*)", section, re.MULTILINE)
    assert len(commands) == 5
    for command in commands:
        result = CliRunner().invoke(app, shlex.split(command))
        assert result.exit_code == 0, (command, result.output)
    names: dict[str, object] = {}
    for block in blocks("data.md", "python"):
        exec(compile(block, "data.md", "exec"), names)
    seen, did = names["lessons"]  # type: ignore[misc]
    assert len(seen) == len(did) > 0
    assert (did >= 0).all()
    assert np.load("out/models/test/multi_agent-01_lettuce_burger.npz")["own"].any()
