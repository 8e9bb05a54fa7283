"""The summary of a load test in a terminal."""

from __future__ import annotations

from io import StringIO

from rich.console import Console

from robotouille_client.loadtest.histogram import Measurements
from robotouille_client.loadtest.load_test import LoadObservation
from robotouille_client.loadtest.report import LoadReport
from robotouille_client.loadtest.terminal_summary import print_summary
from robotouille_client.loadtest.workload import LoadPlan


def test_codes_of_a_server_control_neither_terminal_nor_markup() -> None:
    figures = {
        "server": "x\x1b]0;pwned\x07[/bold]",
        "seconds": 1.0,
        "rooms playing": 1,
        "connections": 1,
        "durations": {},
        "steps": {"rate held": None},
        "traffic": {},
        "server process": None,
        "storm": None,
        "clients": {"busiest process, of a core": 0.1},
        "counts": {"rejected: \x1b[2J\x1b[31mEVIL": 1, "rejected: [/bold]x": 2},
    }
    plan = LoadPlan(url="ws://127.0.0.1:1")
    report = LoadReport(plan, LoadObservation(), Measurements(), figures, [], [])
    shown = StringIO()
    print_summary(report, Console(file=shown, width=300))
    assert "\x1b" not in shown.getvalue()
    assert "rejected: [/bold]x 2" in shown.getvalue()
