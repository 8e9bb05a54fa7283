"""The page of a study: its numbers, that it is repeatable, and what it may do."""

from __future__ import annotations

import random
import re
import resource
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("matplotlib", reason="needs the extra `data`")

import sqlalchemy as sa

from robotouille.replay import read_recording
from robotouille_client.cli.main import app
from robotouille_data.answers.query import reading
from robotouille_data.answers.report.facts import Facts, read_facts
from robotouille_data.answers.report.grouping import grouped, in_order
from robotouille_data.answers.report.intervals import median_interval, share_interval
from robotouille_data.answers.report.write import write_report
from robotouille_data.answers.selection import select_episodes
from robotouille_data.database import database_url, insert, writing_engine
from robotouille_data.errors import CatalogueError
from robotouille_data.indexing import index
from robotouille_data.schema import EPISODES, EVENTS, LABELS, MEASURES, SEATS
from robotouille_data.versions import migrate
from tests.support.page_tags import Tags, check_harmless
from tests.support.random_play import write_recordings
from tests.support.study import write_study

HOSTILE = "<script>alert(1)</script>\"'&$x^2$ \x07\u202e 日本語 </style></svg>]]>-->{0}%s"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("study")
    write_study(found, pairs=2, rounds=2)
    index(database_url(None, found), [found])
    return found


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return page_of(folder)


def page_of(folder: Path, database: str | None = None, **options: Any) -> str:
    path = folder / "page.html"
    write_report(database_url(database, folder), path, **options)
    try:
        return path.read_text(encoding="utf-8")
    finally:
        path.unlink()


def facts_of(folder: Path) -> Facts:
    url = database_url(None, folder)
    with reading(url) as connection:
        selection = select_episodes(connection, url)
        return read_facts(connection, selection, "condition", lambda *_: None)


def text_of(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


# What it says


def test_seats_and_episodes_are_those_of_the_recordings(folder: Path) -> None:
    """By other code: the recordings' own measures and notes."""
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
            idle, present = own.idle, own.acted + own.busy + own.waiting + own.idle
            assert seat.idle_share == (idle / present if present else None)
            times = [
                move["ms"]
                for frame in recording.steps
                for i, move in enumerate(frame["moves"])
                if move["player"] == seat.player
                and move["seq"] > 0
                and str(i) not in frame.get("unmet", {})
            ]
            assert seat.decision_ms == pytest.approx(statistics.mean(times))
        gone = [
            note["player"]
            for note in recording.notes()
            if note["note"] == "roster" and not note["present"] and note["t"] > 0
        ]
        found = facts.interruptions.get(episode.id, {})
        assert found.get("absences", 0) == len(gone)


def test_the_page_says_how_many_reached_the_goal(folder: Path, page: str) -> None:
    said = text_of(page)
    for group in grouped(facts_of(folder)).shown:
        won = sum(bool(each.success) for each in group.episodes)
        found = share_interval(won, len(group.episodes))
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        told = f"{100 * found.middle:.0f} ({100 * found.low:.0f} to {100 * found.high:.0f})"
        assert f"{group.name} {told}" in said


@pytest.mark.slow
def test_chat_is_there_and_can_be_left_out(folder: Path, page: str) -> None:
    said = {
        note["text"]
        for path in folder.glob("*.rbt")
        for note in read_recording(path).notes()
        if note["note"] == "said"
    }
    assert said
    without = page_of(folder, text=False)
    for text in said:
        assert f'<td class="text">{text}</td>' in page
        assert f">{text}<" not in without
    assert "--no-text" in without


@pytest.mark.slow
def test_only_what_is_asked_for(folder: Path) -> None:
    query = "SELECT id FROM episodes JOIN labels ON id = episode_id WHERE value = 'apart-1'"
    page = page_of(folder, query=f"{query} UNION SELECT 1")
    assert "1 episode that the query names and the catalogue has not" in page
    assert "apart-1-1" in page
    assert "apart-2-1" not in page
    assert "apart-1-1" not in page_of(folder, labels={"condition": "together"})
    with pytest.raises(CatalogueError, match="no episode"):
        page_of(folder, labels={"condition": "neither"})
    with pytest.raises(CatalogueError, match="`episode_id` or `id`"):
        page_of(folder, query="SELECT steps FROM episodes")
    with pytest.raises(CatalogueError, match="no id of an episode"):
        page_of(folder, query="SELECT episode AS id FROM episodes")


@pytest.mark.slow
def test_what_is_missing_is_told(folder: Path, tmp_path: Path) -> None:
    write_recordings(tmp_path, 2)
    (tmp_path / "broken.rbt").write_bytes(b"no recording")
    index(database_url(None, tmp_path), [tmp_path])
    page = text_of(page_of(tmp_path))
    assert "2 episodes without a label “condition”" in page
    assert "1 recording of the catalogue that could not be read" in page
    assert "broken.rbt: not a recording" in page
    assert "it takes a label “round”" in page
    assert "(no condition)" in page


def test_links_lead_to_the_recordings(folder: Path, page: str) -> None:
    links = [
        str(attributes["href"])
        for tag, attributes in Tags(page).found
        if tag == "a" and not str(attributes["href"]).startswith("#")
    ]
    assert len(links) == 8
    for link in links:
        assert folder / link in set(folder.glob("*.rbt"))


# What it may do


@pytest.mark.slow
def test_the_same_catalogue_gives_the_same_bytes(folder: Path, page: str, tmp_path: Path) -> None:
    assert page == page_of(folder)
    index(database_url(str(tmp_path / "anew.sqlite"), folder), [folder])
    assert page == page_of(folder, str(tmp_path / "anew.sqlite"))


@pytest.mark.slow
def test_both_databases_give_the_same_page(database: str, folder: Path, page: str) -> None:
    index(database_url(database, folder), [folder])
    assert page_of(folder, database) == page


def test_the_page_asks_for_nothing_and_runs_nothing(page: str) -> None:
    check_harmless(page)


def test_what_others_wrote_is_shown_and_nothing_more(tmp_path: Path) -> None:
    """Labels, names, tasks, reasons and chat are anybody's words."""
    database = str(tmp_path / "c.sqlite")
    with writing_engine(database_url(database, tmp_path)).begin() as connection:
        migrate(connection)
        fill(connection, 3, text=HOSTILE)
    page = page_of(tmp_path, database, by=HOSTILE, title=HOSTILE, labels={HOSTILE: HOSTILE})
    tags = {tag for tag, _ in Tags(page).found}
    assert not tags & {"script", "img", "iframe"}
    assert not {"\x07", "\u202e"} & set(page)
    assert page.count("</style>") == 1


def test_groups_are_in_the_order_of_people() -> None:
    assert in_order(["10", "2", "b", "a10", "a9", ""]) == ["", "2", "10", "a9", "a10", "b"]


@pytest.mark.slow
def test_too_many_groups_are_told(tmp_path: Path) -> None:
    database = str(tmp_path / "c.sqlite")
    with writing_engine(database_url(database, tmp_path)).begin() as connection:
        migrate(connection)
        fill(connection, 40, groups=20)
    page = text_of(page_of(tmp_path, database))
    assert "12 groups of “condition” with 24 episodes: there is room for the 8 largest" in page


def test_seats_are_told_apart_and_a_delay_is_told(tmp_path: Path) -> None:
    database = str(tmp_path / "c.sqlite")
    with writing_engine(database_url(database, tmp_path)).begin() as connection:
        migrate(connection)
        fill(connection, 6, delay=250)
    page = page_of(tmp_path, database)
    for group in ("c0", "c1"):
        for player in ("robot0", "robot1"):
            assert f"{group}: {player}" in page
    assert "12 seats whose actions the study held back, by 250 ms at most" in text_of(page)


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"by": "condtion"}, "no episode has a label 'condtion'; did you mean 'condition'"),
        ({"labels": {"round": "9"}}, "label round=9; the values of 'round': 1, 2, 3"),
    ],
)
def test_labels_that_nobody_has_are_told(tmp_path: Path, asked: dict[str, Any], told: str) -> None:
    database = str(tmp_path / "c.sqlite")
    with writing_engine(database_url(database, tmp_path)).begin() as connection:
        migrate(connection)
        fill(connection, 3)
    with pytest.raises(CatalogueError, match=told):
        page_of(tmp_path, database, **asked)


def fill(
    connection: sa.Connection, count: int, *, groups: int = 2, text: str = "", delay: int = 0
) -> None:
    """Made-up episodes of no recording, with words of somebody's."""
    rng = random.Random(0)
    rows: dict[sa.Table, list[tuple[Any, ...]]] = {
        table: [] for table in (EPISODES, SEATS, EVENTS, LABELS, MEASURES)
    }
    for number in range(count):
        steps, won = rng.randrange(50, 150), rng.random() < 0.5
        rows[EPISODES].append((
            number, f"e{number}{text}", "ended", "2026", "0", f"task{text}", "", "people", 0,
            "realtime", 4.0, 150, "wait", 2, text or ("goal" if won else "step_limit"), "", steps,
            steps / 4, "", "",
        ))  # fmt: skip
        for seat in range(2):
            acted = rng.randrange(10, 40)
            rows[SEATS].append((
                number, seat, f"robot{seat}", text, text or "human", "", acted, 0, 0, steps - acted,
                0, 0, 0, 0, 0, 0, 1, 0, None, 0.5, "", delay,
            ))  # fmt: skip
        rows[EVENTS].append((number, 0, 1, 5, "said", 0, text, text, "{}"))
        rows[LABELS].append((number, text or "condition", text or f"c{number % groups}"))
        if not text:
            rows[LABELS].append((number, "round", str(1 + number % 3)))
        rows[MEASURES].append((number, won, None, None, 0, 0, None, None, None))
    for table, values in rows.items():
        insert(connection, table, values)


@pytest.mark.slow
def test_ten_thousand_episodes_make_a_page_of_bounded_size(tmp_path: Path) -> None:
    database, told = str(tmp_path / "c.sqlite"), list[tuple[str, int, int]]()
    with writing_engine(database_url(database, tmp_path)).begin() as connection:
        migrate(connection)
        fill(connection, 10_000)
    page = page_of(tmp_path, database, progress=lambda *what: told.append(what))
    assert len(page) < 1_000_000
    assert ("episodes", 10_000, 10_000) in told
    assert "4,988 more are not drawn" in page
    assert "the first 100 of them" in page


# Where it fails


def run(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, ["data", "report", *map(str, arguments)])


@pytest.mark.slow
def test_the_command(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    result = run("--folder", folder, "--out", out, "--label", "condition=apart", "--by", "round")
    assert (result.exit_code, result.stdout) == (0, f"{out}: 4 episodes\n")
    for arguments, words in (
        (["--label", "apart"], "NAME=VALUE"),
        (["SELECT 1 AS id"], "no episode"),
        (["DELETE FROM labels"], ""),
        (["--folder", str(tmp_path)], "there is no catalogue"),
    ):
        result = run("--folder", folder, "--out", tmp_path / "other.html", *arguments)
        assert result.exit_code == 1
        assert len(result.stderr.splitlines()) == 1
        assert words in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def limited(*arguments: str) -> subprocess.CompletedProcess[str]:
    """`robotouille data …` with files of 100,000 bytes at most, which is a full disk to it."""
    program = "from robotouille_client.cli.main import main; main()"

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    return subprocess.run(
        [sys.executable, "-c", program, "data", *arguments],
        preexec_fn=limit, capture_output=True, text=True,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.process
def test_a_full_disk_leaves_the_page_as_it_was(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    out.write_text("before")
    result = limited("report", "--folder", str(folder), "--out", str(out))
    assert result.returncode == 1
    assert "page.html" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert out.read_text() == "before"
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.slow
@pytest.mark.process
def test_a_full_disk_leaves_a_catalogue_that_can_be_gone_on_with(tmp_path: Path) -> None:
    write_recordings(tmp_path, 60)
    result = limited("index", str(tmp_path), "--jobs", "1")
    assert result.returncode == 1
    assert "catalogue.sqlite" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    url = database_url(None, tmp_path)
    report = index(url, [tmp_path])
    assert report.indexed + report.unchanged == 60
    with reading(url) as connection:
        assert len(select_episodes(connection, url).ids) == 60


# How sure a number is


def test_shares_have_wilsons_interval() -> None:
    """The numbers of Newcombe's tables (Statistics in Medicine 17, 1998)."""
    for successes, count, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        found = share_interval(successes, count)
        assert found is not None
        assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert share_interval(0, 0) is None


def slow_medians(values: list[float], clusters: list[str], seed: int) -> Iterator[float]:
    """The same draws, cluster by cluster."""
    import numpy as np

    own = {name: [v for v, c in zip(values, clusters, strict=True) if c == name]
           for name in dict.fromkeys(clusters)}  # fmt: skip
    names = list(own)
    for row in np.random.default_rng(seed).integers(len(names), size=(1000, len(names))):
        yield statistics.median([value for place in row for value in own[names[place]]])


@pytest.mark.parametrize("seed", range(5))
def test_medians_have_a_bootstrap_interval(seed: int) -> None:
    import numpy as np

    rng = random.Random(seed)
    clusters = [f"p{rng.randrange(6)}" for _ in range(25)]
    values = [float(rng.randrange(10)) for _ in clusters]
    found = median_interval(values, clusters, seed)
    assert found is not None
    assert found.middle == statistics.median(values)
    low, high = np.quantile(list(slow_medians(values, clusters, seed)), (0.025, 0.975))
    assert (found.low, found.high) == pytest.approx((low, high))


def test_of_too_few_no_interval_is_known() -> None:
    found = median_interval([1.0, 2.0, 3.0], ["a", "a", "b"])
    assert found is not None
    assert (found.middle, found.low, found.high) == (2.0, None, None)
    assert median_interval([], []) is None
