"""Failures that the paper logs, and the classifier's agreement with their labels."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from robotouille_client.cli.main import app
from robotouille_evaluation.metrics.paper_failures import logged_failures


def test_classifier_agrees_with_the_labels_of_the_paper() -> None:
    found = logged_failures()
    assert [each.labelled for each in found] == [
        "state", "action", "transition", "goal", "goal", "goal",
    ]  # fmt: skip
    assert [each.classified for each in found] == [each.labelled for each in found]


def test_command_says_how_few_labels_there_are() -> None:
    result = CliRunner().invoke(app, ["benchmark", "agreement"])
    assert result.exit_code == 0, result.output
    assert "6 of 6 equal; Cohen's kappa 1.00" in result.stdout
    assert "too few to judge the classifier" in result.stdout


def test_labels_need_runs(tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_text("recording,category\na.rbt,goal\n")
    result = CliRunner().invoke(app, ["benchmark", "agreement", str(tmp_path / "labels.csv")])
    assert result.exit_code == 1
    assert "name their runs, too" in result.output
