"""`robotouille cross-play` plays all pairs of partners and prints their means."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from robotouille import World, load_certificate
from robotouille.planning.policies.trained import Actor, layout_of, write_actor
from robotouille_client.cli.main import app

TASK = "training/03@2"


def cross_play(*words: str, task: str = TASK) -> Result:
    return CliRunner().invoke(app, ["cross-play", task, *words])


def idle_actor(path: Path) -> str:
    """Write an actor that does nothing, and return its path."""
    world = World(TASK)
    size, count = world.encoding.size, len(world.ground_actions("robot1")) + 1
    biases = np.zeros(count, np.float32)
    biases[-1] = 30
    columns = np.tile(np.arange(size, dtype=np.int32), (2, 1))
    layout = layout_of(world.encoding, world.players)
    layers = ((np.zeros((size + 2, count), np.float32), biases),)
    write_actor(path, Actor("idle", TASK, layout, columns, np.ones(size, np.float32), layers))
    return str(path)


@pytest.mark.slow
def test_matrix_has_all_pairs_with_intervals(tmp_path: Path) -> None:
    idle, out = idle_actor(tmp_path / "idle.npz"), tmp_path / "means.csv"
    result = cross_play("scripted", idle, "--episodes", "4", "--max-steps", "30", "--out", str(out))
    assert result.exit_code == 0, result.output
    rows = {
        (row["first"], row["other"], row["measure"]): row
        for row in csv.DictReader(out.read_text(encoding="utf-8").splitlines())
    }
    assert len(rows) == 8
    assert float(rows["scripted", "scripted", "steps"]["mean"]) == load_certificate(TASK).length
    own = rows["scripted", "scripted", "success"]
    assert (float(own["mean"]), float(own["high"]), own["episodes"]) == (1, 1, "4")
    assert 0.5 < float(own["low"]) < 0.52  # Wilson's interval of 4 successes in 4
    assert float(rows["scripted", "idle", "success"]["mean"]) == 0
    assert float(rows["idle", "idle", "steps"]["mean"]) == 30
    assert result.stdout.splitlines()[0].split() == ["success", "(%)", "scripted", "idle"]
    assert "with itself: 50 (" in result.output
    assert "with others: 0 (0–" in result.output


@pytest.mark.slow
def test_a_pair_plays_alike_whoever_else_is_there(tmp_path: Path) -> None:
    options = "--episodes", "2", "--max-steps", "12", "--seed", "3"
    both, alone = tmp_path / "both.json", tmp_path / "alone.json"
    cross_play("random", *options, "--out", str(alone))
    cross_play("random", idle_actor(tmp_path / "idle.npz"), *options, "--out", str(both))
    many = json.loads(both.read_text(encoding="utf-8"))["episodes"]
    (found,) = (json.loads(alone.read_text(encoding="utf-8"))["episodes"],)
    assert len(many) == 8
    assert found == [each for each in many if (each["first"], each["other"]) == ("random",) * 2]


def test_scripted_partner_accepts_that_another_one_waits() -> None:
    result = cross_play("random", "scripted", "--episodes", "1", "--max-steps", "30")
    assert result.exit_code == 0, result.output
    assert "scripted with random: success" in result.output


def test_shift_has_points() -> None:
    result = cross_play(
        "random", "--episodes", "1", task="shifts/01_sandwich_bar@2"
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("points")


@pytest.mark.parametrize(
    ("words", "task", "why"),
    [
        (["plannr"], TASK, "unknown partner 'plannr'"),
        (["random", "random"], TASK, "name one of them: NAME=random"),
        (["a=random", "a=scripted"], TASK, "name one of them: NAME=scripted"),
        (["a=plannr"], TASK, "unknown partner 'plannr'"),
        (["=random"], TASK, "unknown partner '=random'; did you mean 'random'?"),
        (["missing.npz"], TASK, "missing.npz: cannot be read"),
        (["scripted"], "shifts/01_sandwich_bar@2", "partner: shifts/01_sandwich_bar is a shift"),
        (["random"], "synchronous/01", "needs two seats or more"),
        (["random", "--out", "means.txt"], TASK, "expected a file .csv or .json"),
        (["random", "--out", "nowhere/means.csv"], TASK, "--out: no folder nowhere"),
    ],
)
def test_wrong_requests_get_one_line(words: list[str], task: str, why: str) -> None:
    result = cross_play(*words, task=task)
    assert result.exit_code != 0
    assert why in result.output.replace("\n", " ")


def test_a_trained_policy_of_another_kitchen_is_refused(tmp_path: Path) -> None:
    result = cross_play(idle_actor(tmp_path / "idle.npz"), task="multi_agent/01@2")
    assert "idle was trained for training/03@2 and cannot play" in result.output.replace("\n", " ")


@pytest.mark.slow
def test_partners_can_be_named(tmp_path: Path) -> None:
    (tmp_path / "rate=1").mkdir()
    file = idle_actor(tmp_path / "rate=1" / "best.npz")
    result = cross_play("one=random", "two=random", file, "--episodes", "1", "--max-steps", "3")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[0].split() == ["success", "(%)", "one", "two", "best"]


def test_error_of_an_own_policy_names_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    code = """class Cook:
    def __init__(self, state, player): pass
    def act(self, state): return state.actions("robot1")[1_000_000]
"""
    (tmp_path / "broken_cook.py").write_text(code, encoding="utf-8")
    result = cross_play("broken_cook:Cook", "--episodes", "1")
    assert result.exit_code == 1
    file, line, message = [each for each in result.stderr.splitlines() if "^" not in each]
    assert str(tmp_path / "broken_cook.py") in file and "line 3, in act" in file
    assert line.strip().startswith("def act")
    assert message.startswith("broken_cook:Cook.act raised IndexError: ")
