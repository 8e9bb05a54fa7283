"""A small drill: a real server is killed a few times while bots and a person play."""

from __future__ import annotations

import asyncio
import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.programs.drill.drill import Plan, missing_kills, run_drill
from tests.programs.drill.report import table, write_json
from tests.programs.drill.verdict import Verdict

SMALL = Plan(kills=2, games=3, processes=1, seed=7, steps=(15, 25), patience=150.0)
LARGER = Plan(kills=5, games=6, processes=2, seed=7, steps=(15, 40), patience=150.0)


def test_kills_that_all_came_outside_of_play_prove_nothing() -> None:
    plan = Plan(kills=3, games=1, windows=0, pages=1)
    verdict = Verdict()
    verdict.restarted.update({"bots running": 1, "pages countdown": 20, "pages waiting": 4})
    assert missing_kills(plan, verdict) == ["no restart of the server fell into play of pages"]
    verdict.restarted["pages running"] += 1
    assert missing_kills(plan, verdict) == []


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize("plan", [SMALL, pytest.param(LARGER, marks=pytest.mark.nightly)])
def test_episodes_survive_kills(tmp_path: Path, plan: Plan) -> None:
    result = asyncio.run(run_drill(plan, tmp_path / "drill", print))
    assert result.ok, table(result)
    write_json(result, tmp_path / "figures.json")
    figures = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))
    assert figures["verdict"]["outcomes"] == result.verdict.outcomes
    assert figures["plan"]["kills"] == figures["signals"]["SIGKILL"] == plan.kills
    assert sum(result.kills.values()) == result.signals.total()
    assert result.lives == 1 + result.signals.total()
    assert sum(result.restored) >= plan.games
    assert result.verdict.games >= plan.games
    assert result.verdict.verified >= result.verdict.games
    assert set(result.verdict.outcomes) <= {"goal", "step_limit"}
    assert max(result.verdict.restarts) >= 2
    assert result.verdict.restarted["bots running"] >= 1
    assert result.verdict.actions > 50
    assert result.verdict.chat > 0


@pytest.mark.browser
@pytest.mark.process
@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.skipif(
    not (shutil.which("Xvfb") and shutil.which("xdotool")), reason="needs Xvfb and xdotool"
)
def test_window_of_a_person_survives_kills(tmp_path: Path) -> None:
    pytest.importorskip("pygame")
    plan = Plan(kills=3, games=1, windows=1, seed=3, steps=(20, 60), patience=150.0)
    result = asyncio.run(run_drill(plan, tmp_path / "drill", print))
    assert result.ok, table(result)
    assert result.pictures >= 1
    assert result.clicks >= 1
    assert result.verdict.restarted["windows running"] >= 1
    assert result.verdict.controllers["human"] >= 2


@pytest.mark.browser
@pytest.mark.process
@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.skipif(
    not (shutil.which("chromium") and find_spec("playwright")),
    reason="needs chromium and playwright",
)
def test_pages_of_people_survive_kills_and_accidents(tmp_path: Path) -> None:
    plan = Plan(kills=3, games=0, pages=1, seed=3, steps=(20, 30), patience=150.0)
    result = asyncio.run(run_drill(plan, tmp_path / "drill", print))
    assert result.ok, table(result)
    assert result.clicks >= 5
    assert result.accidents.total() >= 5
    assert result.accidents["server killed running"] >= 1
    assert result.verdict.restarted["pages running"] >= 1
    assert result.verdict.actions >= 5
