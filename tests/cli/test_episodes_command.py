"""Tables of `robotouille episodes`."""

from __future__ import annotations

import csv
import os
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from threading import Thread

import msgpack
import pytest
from typer.testing import CliRunner
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

from robotouille.errors import FileError
from robotouille.protocol import messages
from robotouille.protocol.codec import MSGPACK
from robotouille_client.cli.episodes import (
    TableError,
    closed_codes,
    listed_row,
    read_requests,
    seconds,
    write_table,
)
from robotouille_client.cli.main import app
from tests.support.server_process import server_process
from tests.support.worker_processes import workers

TABLE = """task,clock,seats,label.condition,label.pair,shown_as.robot2,delay_ms.robot1,chat,phrases
multi_agent/01,realtime,2,bot,p1,human,250,phrases,Yes|No
multi_agent/01,,,human,p2,,,,
"""


def table(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_row_assigns_seats_to_participants(tmp_path: Path) -> None:
    text = "task,participant.robot1,participant.robot2\nx,p01,\n"
    _, (request,) = read_requests(table(tmp_path, text))
    assert request.participants == {"robot1": "p01"}


def test_row_describes_an_episode(tmp_path: Path) -> None:
    rows, (first, second) = read_requests(table(tmp_path, TABLE), open_for=3600.0)
    assert first.labels == {"condition": "bot", "pair": "p1"}
    assert first.treatments["robot2"].shown_as == "human"
    assert first.treatments["robot1"].delay_ms == 250
    assert (first.seats, first.clock, first.phrases) == (2, "realtime", ["Yes", "No"])
    assert (second.seats, second.clock, second.open_for) == (None, None, 3600.0)
    assert rows[1]["label.pair"] == "p2"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("clock\nturn\n", "no column 'task'"),
        ("", "no column 'task'"),
        ("task;clock\nx;turn\n", "use commas"),
        ("task\n", "no row"),
        ("task,label\nx,y\n", "unknown column 'label'"),
        ("task,colour\nx,red\n", "unknown column 'colour'"),
        ("task,task\nx,y\n", "duplicate column 'task'"),
        ("task,seats\nx,two\n", "line 2: seats: 'two' is not a number"),
        ("task,seats\nx,2\nx,99\n", "line 3: seats:"),
        ("task,clock\nx\n", "fewer values"),
        ("task\nx,y\n", "more values"),
        ("task,open_for\nx,soon\n", "line 2: 'soon' is not a duration"),
        ("task,label.a\nx,\x07\n", "line 2: labels.a"),
        ("task\n" + "x\n" * 10_001, "more than 10,000 rows"),
    ],
)
def test_invalid_table_is_explained(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises((TableError, FileError)) as refused:
        read_requests(table(tmp_path, text))
    assert words in str(refused.value)


def test_faults_of_all_rows_are_listed(tmp_path: Path) -> None:
    path = table(tmp_path, "task,seats,grace\nx,99,-1\ny,2,\nz,two,\n")
    done = CliRunner().invoke(app, ["episodes", "open", str(path)])
    assert done.exit_code == 1
    places = [line.removeprefix(f"{path}: ")[:14] for line in done.stderr.splitlines()]
    assert places == ["line 2: seats:", "line 2: grace:", "line 4: seats:"]


def test_missing_or_binary_table_is_an_error(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["episodes", "open", str(tmp_path / "none.csv")])
    assert done.exit_code == 1
    assert "cannot be read" in done.output
    (tmp_path / "binary.csv").write_bytes(b"task\n\xff\xfe\n")
    with pytest.raises(TableError, match="not UTF-8"):
        read_requests(tmp_path / "binary.csv")


def test_huge_table_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.csv"
    path.touch()
    os.truncate(path, 67_108_865)
    with pytest.raises(FileError, match="longer than 67,108,864 bytes"):
        read_requests(path)


@pytest.mark.parametrize(("text", "expected"), [("90", 90), ("1.5h", 5400), ("30d", 2_592_000)])
def test_durations_have_units(text: str, expected: float) -> None:
    assert seconds(text) == expected


def test_written_table_lists_codes_to_close(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    write_table([{"code": "A", "token.robot1": "x"}, {"code": "B"}], path, secret=True)
    assert path.stat().st_mode & 0o077 == 0
    assert closed_codes(path) == ["A", "B"]
    with pytest.raises(TableError, match="no column 'code'"):
        closed_codes(table(tmp_path, "task\nx\n"))


def test_listed_names_are_no_formulas() -> None:
    info = messages.EpisodeInfo(
        episode="0011223344556677", code="KQXZB-MHTWA", task="multi_agent/01", clock="turn",
        phase="ended", step=3, max_steps=9, seats=[], labels={"group": "@a"},
        reason="abandoned", detail="=cmd() left",
    )  # fmt: skip
    row = listed_row(info, datetime.now(UTC))
    assert (row["detail"], row["label.group"]) == ("'=cmd() left", "'@a")


def test_lists_control_no_terminal_and_odd_times_are_left_out(
    capsys: pytest.CaptureFixture[str],
) -> None:
    info = messages.EpisodeInfo(
        episode="0011223344556677", code="KQXZB-MHTWA", task="a\x1b[2J", clock="turn",
        phase="ended", step=3, max_steps=9, seats=[], closes=1e300, labels={"group": "b"},
        reason="abandoned", detail="left\x07",
    )  # fmt: skip
    row = listed_row(info, datetime.now(UTC))
    assert row["closes"] == ""
    write_table([row], None, secret=False)
    shown = capsys.readouterr().out
    assert "\x1b" not in shown and "\x07" not in shown
    assert "a\N{REPLACEMENT CHARACTER}[2J" in shown


@pytest.mark.process
def test_commands_reach_all_workers(tmp_path: Path) -> None:
    rows = "".join(f"multi_agent/01,{'ab'[number % 4 > 1]}\n" for number in range(8))
    path, opened = table(tmp_path, f"task,label.group\n{rows}"), tmp_path / "opened.csv"
    with workers(tmp_path / "recordings", 2) as (_, port):

        def run(*words: str) -> str:
            done = CliRunner().invoke(app, ["episodes", *words, "--url", f"ws://127.0.0.1:{port}"])
            assert done.exit_code == 0, done.output
            return done.stderr.strip()

        assert run("open", str(path), "--out", str(opened)) == "8 opened"
        codes = closed_codes(opened)
        assert Counter(code[0] for code in codes) == {"A": 4, "B": 4}
        assert run("list", "--label", "group=a") == "4 episodes"
        assert run("close", "--label", "group=a") == "4 closed"
        assert run("close", codes[2], codes[3]) == "2 closed"
        assert run("close", "--from", str(opened)) == "2 closed"
        assert run("list", "--closed") == "8 episodes"


NODES = 3


@contextmanager
def cluster() -> Iterator[tuple[list[str], set[str]]]:
    """Serve nodes that close their own episodes, and yield their URLs and the closed episodes.

    Node N has the episodes whose number leaves the remainder N.
    """
    urls: list[str] = []
    closed: set[str] = set()

    def handle(node: int, socket: ServerConnection) -> None:
        for payload in socket:
            message = msgpack.unpackb(payload)
            answer = {
                "type": "welcome", "protocol": 1, "server": "x", "session": "s", "resume": "r",
                "role": "host", "grace": 1.0, "nodes": urls[:node] + urls[node + 1 :],
            }  # fmt: skip
            if message["type"] == "close":
                answer = {"type": "closed", "ref": message["ref"], "episode": message["episode"]}
                home = int(message["episode"]) % NODES
                if home != node:
                    answer.update({"type": "moved", "port": 1, "url": urls[home]})
                elif message["episode"] in closed:
                    answer.update({"type": "error", "code": "episode/unknown", "message": "no"})
                else:
                    closed.add(message["episode"])
            socket.send(msgpack.packb(answer))

    with ExitStack() as stack:
        for node in range(NODES):
            server = stack.enter_context(
                serve(
                    partial(handle, node), "127.0.0.1", 0, subprotocols=[Subprotocol(MSGPACK.name)]
                )
            )
            stack.callback(server.shutdown)
            urls.append(f"ws://127.0.0.1:{server.socket.getsockname()[1]}")
            Thread(target=server.serve_forever, daemon=True).start()
        yield urls, closed


def test_episodes_on_all_nodes_are_closed() -> None:
    codes = [str(number) for number in (5, 0, 4, 2, 1, 3)]
    with cluster() as (urls, closed):
        done = CliRunner().invoke(app, ["episodes", "close", *codes, "--url", ",".join(urls)])
    assert (done.exit_code, done.stderr.strip()) == (0, "6 closed")
    assert closed == set(codes)


@pytest.mark.process
def test_refused_line_is_named_and_open_episodes_are_kept(tmp_path: Path) -> None:
    path = table(tmp_path, "task,label.pair\nmulti_agent/01,p1\nmulti_agent/none,p2\n")
    opened, listed = tmp_path / "opened.csv", tmp_path / "listed.csv"
    with server_process(tmp_path) as server:
        where = ["--url", server.url]
        refused = CliRunner().invoke(
            app, ["episodes", "open", str(path), "--out", str(opened), *where]
        )
        CliRunner().invoke(app, ["episodes", "list", "--out", str(listed), *where])
        kept = opened.read_bytes()
        again = CliRunner().invoke(
            app, ["episodes", "open", str(path), "--out", str(opened), *where]
        )
    assert again.exit_code == 2
    assert "exists and may contain codes" in again.stderr
    assert opened.read_bytes() == kept
    assert refused.exit_code == 1
    assert "line 3: " in refused.stderr
    assert "multi_agent/none" in refused.stderr
    assert "1 of 2 episodes are open and were written" in refused.stderr
    (first,) = csv.DictReader(opened.read_text("utf-8").splitlines())
    rows = list(csv.DictReader(listed.read_text("utf-8").splitlines()))
    (found,) = [row for row in rows if row["code"] == first["code"]]
    assert found["label.pair"] == first["label.pair"] == "p1"
    assert datetime.fromisoformat(found["closes"]) > datetime.now(UTC)
