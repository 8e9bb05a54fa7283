"""Failure labels: files, and agreement with the classifier."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.metrics import EpisodeMeasures
from robotouille_evaluation.metrics.rows import Category, FailureRow
from robotouille_evaluation.metrics.statistics import Label, agreement, cohens_kappa, read_labels
from tests.support.episode_rows import row

ROWS = [
    {"recording": "a.rtr", "category": "goal", "subcategory": "bad start", "labeller": "kim"},
    {"recording": "b.rtr", "category": "transition"},
]


def test_json_and_csv_are_equivalent(tmp_path: Path) -> None:
    (tmp_path / "labels.json").write_text(json.dumps(ROWS))
    (tmp_path / "labels.csv").write_text(
        "recording,category,subcategory,labeller\na.rtr,goal,bad start,kim\nb.rtr,transition,,\n"
    )
    found = read_labels(tmp_path / "labels.json")
    assert found == read_labels(tmp_path / "labels.csv")
    assert found[0] == Label.model_validate(ROWS[0])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("x.json", "{"),
        ("x.json", '[{"recording": "a"}]'),
        ("x.json", '[{"recording": "a", "category": "bad mood"}]'),
        ("x.csv", "recording,category\na.rtr,goal,surplus\n"),
        ("x.csv", "recording\na.rtr\n"),
    ],
)
def test_invalid_label_files(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FileError):
        read_labels(tmp_path / name)


def test_kappa_by_hand() -> None:
    # Both say "goal" 20 times and "state" 15 times, and differ 5 + 10 times of 50: p = 0.7.
    # One says "goal" 25 of 50 times, the other 30:
    # e = 0.5 · 0.6 + 0.5 · 0.4 = 0.5; (0.7 - 0.5) / 0.5 = 0.4.
    one = ["goal"] * 20 + ["goal"] * 5 + ["state"] * 10 + ["state"] * 15
    other = ["goal"] * 20 + ["state"] * 5 + ["goal"] * 10 + ["state"] * 15
    assert cohens_kappa(one, other) == pytest.approx(0.4)


def test_undefined_kappa() -> None:
    assert cohens_kappa([], []) is None
    assert cohens_kappa(["goal"], ["goal"]) is None
    with pytest.raises(ValueError, match="not paired"):
        cohens_kappa(["goal"], [])


def test_agreement_pairs_by_recording() -> None:
    goal = EpisodeMeasures(failure=FailureRow(category=Category.GOAL, subcategory="wrong order"))
    rule = EpisodeMeasures(
        failure=FailureRow(category=Category.TRANSITION, subcategory="another rule")
    )
    rows = [
        row(recording="a.rtr", measures=goal),
        row(recording="b.rtr", measures=rule),
        row(recording="c.rtr"),
        row(),
    ]
    labels = [Label.model_validate(each) for each in ROWS]
    assert agreement(rows, labels) == 1.0
    assert agreement(rows, []) is None
