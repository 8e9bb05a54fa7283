"""Report page of a study."""

from __future__ import annotations

import random
import re
import resource
import statistics
import subprocess
import sys
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("matplotlib", reason="needs the extra `data`")

import sqlalchemy as sa

from robotouille.episode import Clock
from robotouille.episode.tallies import Activity
from robotouille.html_report.intervals import wilson_interval
from robotouille.replay import read_recording
from robotouille.replay.compression import compress
from robotouille.replay.measures import activities
from robotouille_client.cli.main import app
from robotouille_data.database import CatalogueError, database_url, insert, migrate, writing_engine
from robotouille_data.indexing import index
from robotouille_data.query import reading, select_episodes
from robotouille_data.report.facts import Facts, grouped, read_facts
from robotouille_data.report.page import ReportOptions, write_report
from robotouille_data.schema import EPISODES, EVENTS, LABELS, MEASURES, SEATS
from tests.support.page_tags import Tags, check_harmless
from tests.support.random_play import random_stream, write_recordings

HOSTILE = "<script>alert(1)</script>\"'&$x^2$ \x07\u202e 日本語 </style></svg>]]>-->{0}%s"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("study")
    for seed, (condition, pair, number) in enumerate(product(("apart", "together"), "12", "12")):
        labels = {"condition": condition, "pair": f"{condition}-{pair}", "round": number}
        stream = random_stream(seed, clock=Clock.REALTIME, steps=100, labels=labels)
        (found / f"{condition}-{pair}-{number}.rbt").write_bytes(compress(stream))
    index(database_url(None, found), [found])
    return found


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return page_of(folder)


def page_of(folder: Path, database: str | None = None, **options: Any) -> str:
    path = folder / "page.html"
    progress = options.pop("progress", lambda *_: None)
    write_report(database_url(database, folder), path, ReportOptions(**options), progress)
    try:
        return path.read_text(encoding="utf-8")
    finally:
        path.unlink()


def facts_of(folder: Path, database: str | None = None) -> Facts:
    url = database_url(database, folder)
    with reading(url) as connection:
        selection = select_episodes(connection, url)
        return read_facts(connection, selection, "condition", lambda *_: None)


def text_of(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


# Content


@pytest.mark.slow
def test_facts_equal_those_of_the_recordings(folder: Path) -> None:
    """Compare the facts with the recordings' own measures and notes."""
    facts = facts_of(folder)
    assert len(facts.episodes) == 8
    for episode in facts.episodes:
        assert episode.path is not None
        recording = read_recording(Path(episode.path))
        measures, labels = recording.measures(), recording.header["labels"]
        assert (episode.group, episode.pair) == (labels["condition"], labels["pair"])
        assert (episode.round, episode.steps) == (labels["round"], measures.steps)
        assert episode.success == measures.success
        for seat in (each for each in facts.seats if each.episode is episode):
            own = measures.seats[seat.player]
            inactive = own.idle + own.waiting
            present = own.acted + own.busy + inactive
            assert seat.inactive_share == (inactive / present if present else None)
            assert seat.unused_share is None
            times = [
                move["ms"]
                for frame, (_, activity) in zip(recording.steps, activities(recording), strict=True)
                for move in frame["moves"]
                if move["player"] == seat.player and activity.did[seat.player] is Activity.ACTED
            ]
            assert seat.decision_ms == pytest.approx(statistics.mean(times))
        gone = 0
        was_present: dict[str, bool] = {}
        for note in recording.notes():
            if note["note"] == "roster":
                gone += was_present.get(note["player"], False) and not note["present"]
                was_present[note["player"]] = note["present"]
        found: Mapping[str, int] = facts.interruptions.get(episode.id, {})
        assert found.get("absences", 0) == gone


@pytest.mark.slow
def test_page_shows_success_with_intervals(tmp_path: Path) -> None:
    database = random_catalogue(tmp_path, 20)
    said = text_of(page_of(tmp_path, database))
    for group in grouped(facts_of(tmp_path, database)).shown:
        won = sum(bool(each.success) for each in group.episodes)
        found = wilson_interval(won, len(group.episodes))
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        expected = f"{100 * found.estimate:.0f} ({100 * found.low:.0f}–{100 * found.high:.0f})"
        assert f"{group.name} {expected}" in said


@pytest.mark.slow
def test_chat_can_be_left_out(folder: Path, page: str) -> None:
    said = {
        note["text"]
        for path in folder.glob("*.rbt")
        for note in read_recording(path).notes()
        if note["note"] == "said" and note["text"].isprintable()
    }
    assert said
    without = page_of(folder, text=False)
    for text in said:
        assert f'<td class="text">{text}</td>' in page
        assert f">{text}<" not in without
    assert "--no-text" in without


@pytest.mark.slow
def test_query_and_labels_select_episodes(folder: Path) -> None:
    query = "SELECT id FROM episodes JOIN labels ON id = episode_id WHERE value = 'apart-1'"
    page = page_of(folder, query=f"{query} UNION SELECT 1")
    assert "1 episode of the query missing from the catalogue" in page
    assert "apart-1-1" in page
    assert "apart-2-1" not in page
    assert "apart-1-1" not in page_of(folder, labels={"condition": "together"})
    with pytest.raises(CatalogueError, match="no episode"):
        page_of(folder, labels={"condition": "neither"})
    with pytest.raises(CatalogueError, match="`episode_id` or `id`"):
        page_of(folder, query="SELECT steps FROM episodes")
    with pytest.raises(CatalogueError, match="not an episode id"):
        page_of(folder, query="SELECT episode AS id FROM episodes")


@pytest.mark.slow
def test_page_lists_missing_labels_and_damaged_recordings(folder: Path, tmp_path: Path) -> None:
    write_recordings(tmp_path, 2)
    (tmp_path / "broken.rbt").write_bytes(b"no recording")
    index(database_url(None, tmp_path), [tmp_path])
    page = text_of(page_of(tmp_path))
    assert "2 episodes without a label “condition”" in page
    assert "1 recording of the catalogue could not be read" in page
    assert "broken.rbt: not a recording" in page
    assert "needs a label “round”" in page
    assert "(no condition)" in page


@pytest.mark.slow
def test_links_point_to_the_recordings(folder: Path, page: str) -> None:
    links = [
        str(attributes["href"])
        for tag, attributes in Tags(page).found
        if tag == "a" and not str(attributes["href"]).startswith("#")
    ]
    assert len(links) == 8
    for link in links:
        assert folder / link in set(folder.glob("*.rbt"))


# Safety and repeatability


@pytest.mark.slow
def test_equal_catalogues_give_equal_bytes(folder: Path, page: str, tmp_path: Path) -> None:
    assert page == page_of(folder)
    index(database_url(str(tmp_path / "other.sqlite"), folder), [folder])
    assert page == page_of(folder, str(tmp_path / "other.sqlite"))


@pytest.mark.slow
def test_page_has_no_scripts_and_no_external_resources(page: str) -> None:
    check_harmless(page)


@pytest.mark.slow
def test_text_of_strangers_is_escaped(tmp_path: Path) -> None:
    database = random_catalogue(tmp_path, 3, text=HOSTILE)
    page = page_of(tmp_path, database, by=HOSTILE, title=HOSTILE, labels={HOSTILE: HOSTILE})
    tags = {tag for tag, _ in Tags(page).found}
    assert not tags & {"script", "img", "iframe"}
    assert not {"\x07", "\u202e"} & set(page)
    assert page.count("</style>") == 1


@pytest.mark.slow
def test_page_says_which_groups_are_left_out(tmp_path: Path) -> None:
    database = random_catalogue(tmp_path, 40, groups=20)
    page = text_of(page_of(tmp_path, database))
    assert "12 groups of “condition” with 24 episodes: there is room for the 8 largest" in page


@pytest.mark.slow
def test_roles_are_separate_and_delays_are_noted(tmp_path: Path) -> None:
    database = random_catalogue(tmp_path, 6, delay=250)
    page = page_of(tmp_path, database)
    for group in ("c0", "c1"):
        for player in ("robot0", "robot1"):
            assert f"{group}: {player}" in page
    assert "the study delayed the actions of 12 seats by up to 250 ms" in text_of(page)


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ({"by": "condtion"}, "no episode has a label 'condtion'; did you mean 'condition'"),
        ({"labels": {"round": "9"}}, "label round=9; the values of 'round': 1, 2, 3"),
    ],
)
def test_unknown_labels_get_a_suggestion(
    tmp_path: Path, asked: dict[str, Any], expected: str
) -> None:
    database = random_catalogue(tmp_path, 3)
    with pytest.raises(CatalogueError, match=expected):
        page_of(tmp_path, database, **asked)


def random_catalogue(
    folder: Path,
    count: int,
    *,
    groups: int = 2,
    text: str = "",
    delay: int = 0,
    score: tuple[int, int, int, int] | None = None,
) -> str:
    """Return a database of random episodes without recordings."""
    rng = random.Random(0)
    rows: dict[sa.Table, list[tuple[Any, ...]]] = {
        table: [] for table in (EPISODES, SEATS, EVENTS, LABELS, MEASURES)
    }
    for number in range(count):
        steps, won = rng.randrange(50, 150), rng.random() < 0.5
        rows[EPISODES].append((
            number, f"e{number}{text}", "ended", "2026", None, None, "0", f"task{text}", "",
            "people", 0, "realtime", 4.0, 150, "wait", 30.0, "free", "[]", 2,
            text or ("goal" if won else "step_limit"), "", steps, steps / 4, steps / 4, "", "",
        ))  # fmt: skip
        for seat in range(2):
            acted = rng.randrange(10, 40)
            rows[SEATS].append((
                number, seat, f"robot{seat}", text, text or "human", "", acted, 0, 0, steps - acted,
                0, 0, 0, None, None, 0, 0, 0, 0, 1, 0, None, 0.5, "", delay, "",
            ))  # fmt: skip
        rows[EVENTS].append((number, 0, 1, 5, "said", 0, text, text, "{}"))
        rows[LABELS].append((number, text or "condition", text or f"c{number % groups}"))
        if not text:
            rows[LABELS].append((number, "round", str(1 + number % 3)))
        success, scored = (won, [None] * 4) if score is None else (None, score)
        rows[MEASURES].append((number, success, None, None, 0, 0, *[None] * 3, *scored))
    database = str(folder / "c.sqlite")
    with writing_engine(database_url(database, folder)).begin() as connection:
        migrate(connection)
        for table, values in rows.items():
            insert(connection, table, values)
    return database


@pytest.mark.slow
def test_page_shows_scores_of_shifts(tmp_path: Path) -> None:
    page = page_of(tmp_path, random_catalogue(tmp_path, 6, score=(157, 6, 2, 314)))
    assert "Scores of shifts" in page
    assert "c0 3 157 (157–157) 50 (50–50) 6.0 2.0" in text_of(page)
    assert "157 points" in text_of(page)


@pytest.mark.slow
def test_page_of_10_000_episodes_is_below_1_mb(tmp_path: Path) -> None:
    database, expected = random_catalogue(tmp_path, 10_000), list[tuple[str, int, int]]()
    page = page_of(tmp_path, database, progress=lambda *what: expected.append(what))
    assert len(page) < 1_000_000
    assert ("episodes", 10_000, 10_000) in expected
    assert "4,988 more are not drawn" in page
    assert "the first 100 of them" in page


# Failures


def run(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, ["data", "report", *map(str, arguments)])


@pytest.mark.slow
def test_report_command(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    result = run("--folder", folder, "--out", out, "--label", "condition=apart", "--by", "round")
    assert (result.exit_code, result.stdout) == (0, f"{out}: 4 episodes\n")
    for arguments, words in (
        (["--label", "apart"], "NAME=VALUE"),
        (["SELECT 1 AS id"], "no episode"),
        (["DELETE FROM labels"], ""),
        (["--folder", str(tmp_path)], "no catalogue"),
    ):
        result = run("--folder", folder, "--out", tmp_path / "other.html", *arguments)
        assert result.exit_code == 1
        assert len(result.stderr.splitlines()) == 1
        assert words in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def limited(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `robotouille data …` with at most 100,000 bytes per file, like on a full disk."""
    program = "from robotouille_client.cli.main import main; main()"

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    return subprocess.run(
        [sys.executable, "-c", program, "data", *arguments],
        preexec_fn=limit, capture_output=True, text=True,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.process
def test_full_disk_keeps_the_old_page(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    out.write_text("before")
    result = limited("report", "--folder", str(folder), "--out", str(out))
    assert result.returncode == 1
    assert "page.html" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert out.read_text() == "before"
    assert list(tmp_path.iterdir()) == [out]
