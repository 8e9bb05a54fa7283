"""Command `robotouille-loadtest`: processes, files and errors."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robotouille.errors import RobotouilleError
from robotouille_client.loadtest import cli
from robotouille_client.loadtest import worker_pool as open_files
from robotouille_client.loadtest.server_monitor import DELTA_AGE, LATENESS, parse_page
from robotouille_server.runtime.metrics import Metrics
from tests.support.processes import process

COMMAND = [sys.executable, "-c", "from robotouille_client.loadtest.cli import main; main()"]


def started(url: str, *flags: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, "--url", url, *flags],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )


@pytest.mark.process
@pytest.mark.slow
def test_interrupt_reports_the_results_so_far(tmp_path: Path) -> None:
    """Two processes play with all kinds of bots until Ctrl+C."""
    report, page = tmp_path / "report.json", tmp_path / "report.html"
    with process(tmp_path / "recordings") as (_, url, _code):
        test = started(
            url, "--rooms", "4", "--mix", "realtime:2,lockstep:1,turn:1", "--ramp", "0.2",
            "--duration", "600", "--processes", "2", "--spectators", "3", "--slow-readers", "1",
            "--json", str(report), "--html", str(page),
        )  # fmt: skip
        assert test.stderr is not None
        received = iter(test.stderr)
        assert any(line.startswith("measuring") for line in received)
        assert re.search(r"\d+ connected, 4 rooms play; \d+ steps/s", next(received))
        test.send_signal(signal.SIGINT)
        output, errors = test.communicate(timeout=60)
        assert test.returncode == 0, errors

    assert "Interrupted: the figures cover the time until then." in output
    assert re.search(r"load +2 realtime, 1 lockstep, 1 turn rooms at 10 actions/s", output)
    assert re.search(r"action to delta, lockstep +\d", output)
    to_the_server = r"traffic +[1-9][\d,]* messages/s, [\d,]+ KiB/s to the server"
    assert re.search(
        to_the_server + r"; [1-9][\d,]* messages/s, [1-9][\d,]* KiB/s from the server", output
    )
    assert re.search(r"server +\d+\.\d\d cores, \d+ MiB; .* KiB per idle spectator", output)

    plain = json.loads(report.read_text())
    figures = plain["figures"]
    assert figures["interrupted"] is True
    assert figures["rooms playing"] == 4
    assert figures["server"].startswith("robotouille ")
    assert figures["steps"]["by the server"]["count"] > 0
    assert figures["durations"]["action, realtime"]["count"] > 0
    for flow in ("messages in", "messages out", "bytes in", "bytes out"):
        assert figures["traffic"][flow] > 0, flow
        assert figures["traffic"][f"{flow} a second"] > 0, flow
    assert plain["plan"]["mix"] == {"realtime": 2, "lockstep": 1, "turn": 1}
    assert {row["measured"] for row in plain["series"]} == {True, False}

    html = page.read_text()
    assert html.count("<svg") >= 4
    assert "storm over" not in html
    assert not re.search(r'(src|href)="(?!#)', html), "the page needs other files"
    ids = re.findall(r' id="([^"]+)"', html)
    assert len(ids) == len(set(ids))


@pytest.mark.process
@pytest.mark.slow
def test_a_server_that_lets_nobody_play_is_quoted(tmp_path: Path) -> None:
    with process(tmp_path, "--max-episodes", "1") as (_, url, _code):
        test = started(url, "--rooms", "2", "--ramp", "0", "--duration", "1")
        _, errors = test.communicate(timeout=60)
    assert test.returncode == 1
    last = errors.splitlines()[-1]
    assert re.fullmatch(r"no room could start: server/full: 1 episodes .* \(2 times\)", last)


@pytest.mark.parametrize(
    ("flags", "fault"),
    [
        (["--rooms", "-3"], "--rooms: Input should be greater than or equal to 0, found -3"),
        (["--rooms", "0"], "nothing to do: use --rooms or --spectators"),
        (["--mix", "chess:1"], "--mix: unknown clock 'chess'"),
        (["--mix", "turn:0"], "at least one clock needs a weight above 0"),
        (["--rate", "1000"], "--rate: Input should be less than or equal to 60, found 1000.0"),
        (["--duration", "0"], "--duration: Input should be greater than 0, found 0.0"),
        (["--rooms", "5", "--storm", "11"], "--storm: 5 rooms have only 10 players to cut"),
        (["--rooms", "2", "--processes", "3"], "--processes: 3 is more than the number of rooms"),
        (
            ["--rooms", "0", "--spectators", "1", "--slow-readers", "1"],
            "--slow-readers needs --rooms",
        ),
        (["--task", "no/such"], "no task or file 'no/such'"),
        (["--cpus", "77777"], "--cpus: no core 77777"),
        (["--cpus", "0-99999999999"], "--cpus: no core"),
        (["--cpus", "99999999999-0"], "--cpus: '99999999999-0' is not a core"),
        (["--cpus", "9" * 5000], "9' is not a core; expected cores like 1,3 or 2-5"),
        (["--cpus", "\u00b2"], "is not a core; expected cores like 1,3 or 2-5"),
        (
            ["--mix", f"turn:{'9' * 5000}"],
            "--mix: the weight of turn must be a whole number, found '99",
        ),
        (["--spectators-per-room", "0"], "--spectators-per-room: Input should be greater"),
        (["--pid", "-1"], "--pid"),
        (["--json", "/no/such/folder/x.json"], "--json: no folder /no/such/folder"),
        (["--html", "."], "--html: '.' is a folder"),
        (["--url", "http://x"], "'http://x' is not a WebSocket URL"),
        (["--pid", "999999999"], "process 999999999"),
    ],
)
def test_invalid_options_are_explained_before_the_test(flags: list[str], fault: str) -> None:
    import typer

    app = typer.Typer()
    app.command()(cli.command)
    result = CliRunner().invoke(app, ["--port", "9", *flags])
    assert result.exit_code in (1, 2)
    assert fault in result.output


def test_limit_of_open_files_is_raised_or_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    import resource

    limits = [(100, 5000)]
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, new: limits.append(new))
    open_files.allow_open_files(10)
    assert len(limits) == 1
    open_files.allow_open_files(1000)
    assert limits[-1][0] >= 1000
    assert limits[-1][1] == 5000
    with pytest.raises(RobotouilleError, match=r"6,000 connections .* at most 5,000 are allowed"):
        open_files.allow_open_files(6000)


def test_histograms_of_the_server_are_read() -> None:
    metrics = Metrics()
    before = parse_page(metrics.page().decode())
    for late in [0.0004] * 90 + [0.03] * 9 + [7.0]:
        metrics.lateness.observe(late)
        metrics.age.observe(0.0003)
    page = parse_page(metrics.page().decode()).since(before)
    lateness = page.histograms[LATENESS]
    assert lateness.count == 100
    assert lateness.share_within(0.02) == 0.9
    assert lateness.share_within(0.05) == 0.99
    assert lateness.share_within(0.0123) is None
    assert 0.0 < (lateness.percentile(50) or 0) <= 0.0005
    assert 0.02 < (lateness.percentile(95) or 0) <= 0.05
    assert lateness.percentile(99.9) == 1.0
    assert page.histograms[DELTA_AGE].count == 100
    assert parse_page("nonsense\n# HELP x y\n").values == {}
