"""Annotations of recordings by several coders, and their agreement."""

from __future__ import annotations

import json
import tracemalloc
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from robotouille.errors import RobotouilleError
from robotouille.replay.annotations import (
    Annotations,
    Codebook,
    agreement,
    alpha,
    cohen,
    read_annotations,
    read_codebook,
)
from robotouille.replay.container import MAX_FRAMES
from robotouille_client.cli.main import app
from tests.support.thorough import thorough

# The example of Krippendorff (2011), Computing Krippendorff's alpha-reliability, section A.
MEG = (0, 1, 0, 0, 0, 0, 0, 0, 1, 0)
OWEN = (1, 1, 1, 0, 0, 1, 0, 0, 0, 0)


def coded(coder: str, *spans: tuple[int, int], recording: str = "r", **changes: Any) -> Annotations:
    rows = [{"label": "help", "first": first, "last": last} for first, last in spans]
    fields = {
        "format": 1,
        "coder": coder,
        "recording": recording,
        "task": "soup",
        "steps": 9,
        "labels": ["help", "wait"],
        "annotations": rows,
    }
    return Annotations.model_validate({**fields, **changes})


def test_alpha_of_the_published_example() -> None:
    # 14 zeros, 6 ones and 4 units that differ: 1 - (20 - 1) * (4 + 4) / (2 * 14 * 6) = 0.095.
    assert alpha(Counter(zip(MEG, OWEN, strict=True))) == pytest.approx(1 - 19 * 8 / 168)
    assert alpha(Counter(zip(MEG, OWEN, strict=True))) == pytest.approx(0.095, abs=0.001)


def test_kappa_of_the_published_example() -> None:
    # Observed 6 of 10. Expected 0.2 * 0.4 + 0.8 * 0.6 = 0.56. Kappa = 0.04 / 0.44.
    assert cohen(Counter(zip(MEG, OWEN, strict=True))) == pytest.approx(0.04 / 0.44)


def test_equal_and_opposite_coders() -> None:
    assert alpha(Counter(zip(MEG, MEG, strict=True))) == pytest.approx(1)
    assert cohen(Counter(zip(MEG, MEG, strict=True))) == pytest.approx(1)
    half, other = (0, 1) * 5, (1, 0) * 5
    assert cohen(Counter(zip(half, other, strict=True))) == pytest.approx(-1)
    assert alpha(Counter([(0, 0)] * 5)) is None
    assert cohen(Counter([(0, 0)] * 5)) is None


def test_alpha_of_three_coders() -> None:
    # Units 111, 000, 110: values 9, ones 5, zeros 4, observed 2 * 2 * 1 / 2 = 2.
    assert alpha(Counter([(1, 1, 1), (0, 0, 0), (1, 1, 0)])) == pytest.approx(
        1 - 8 * 2 / (2 * 5 * 4)
    )


def test_agreement_is_by_step_and_label() -> None:
    meg = coded("meg", (1, 1), (8, 8))
    owen = coded("owen", (0, 2), (5, 5))
    helped, waited = agreement([owen, meg])
    assert (helped.label, helped.coders, helped.units) == ("help", 2, 10)
    assert helped.used == pytest.approx(0.3)
    assert helped.kappa == pytest.approx(0.04 / 0.44)
    assert helped.alpha == pytest.approx(1 - 19 * 8 / 168)
    assert (waited.kappa, waited.alpha, waited.used) == (None, None, 0)


def test_agreement_of_many_coders_is_counted_by_their_number() -> None:
    """Each combination of forty coders was kept, which took gigabytes."""
    files = [coded(f"c{n:02}", (n % 10, 9), steps=9) for n in range(40)]
    helped, _ = agreement(files)
    shares = [4 * (step + 1) / 40 for step in range(10)]
    assert helped.used == pytest.approx(sum(shares) / 10)
    observed = sum(2 * (40 * s) * (40 - 40 * s) / 39 for s in shares)
    ones = 40 * sum(shares)
    assert helped.alpha == pytest.approx(1 - 399 * observed / (2 * ones * (400 - ones)))
    many = [
        coded(f"c{n:02}", *[(s, s) for s in range(2_000) if s >> n % 11 & 1], steps=2_000)
        for n in range(40)
    ]
    tracemalloc.start()
    list(agreement(many))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4_000_000


@thorough(examples=100)
@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)).map(sorted), max_size=8))
def test_overlapping_spans_cover_their_union(spans: list[list[int]]) -> None:
    covered = {step for first, last in spans for step in range(first, last + 1)}
    coder = coded("meg", *[(first, last) for first, last in spans])
    steps = range(11)
    changes = [step for step in steps if (step in covered) != (step - 1 in covered)]
    assert list(coder.changes("help")) == changes


def test_many_long_spans_are_summed_up_once() -> None:
    # One pass over all steps for each span would take hours.
    steps = MAX_FRAMES
    coder = coded("meg", *[(0, steps)] * 50_000, steps=steps)
    assert list(coder.changes("help")) == [0, steps + 1]


def test_long_recordings_cost_no_more_than_short_ones() -> None:
    """Files of 2 KiB that claim a million steps took minutes and gigabytes."""
    labels = [f"label {number}" for number in range(40)]
    files = [coded(name, steps=MAX_FRAMES, labels=["help", *labels[1:]]) for name in "abcdefghij"]
    tracemalloc.start()
    found = list(agreement(files))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [each.units for each in found] == [MAX_FRAMES + 1] * 40
    assert most < 1_000_000


def test_recordings_of_one_coder_do_not_count() -> None:
    files = [coded("meg", (1, 2)), coded("owen", (1, 2)), coded("meg", (0, 0), recording="other")]
    assert next(agreement(files)).units == 10
    with pytest.raises(RobotouilleError, match="no recording was coded by two"):
        list(agreement(files[1:]))


def test_three_coders_have_no_kappa() -> None:
    found = next(agreement([coded(name, (1, 2)) for name in "abc"]))
    assert found.kappa is None
    assert found.alpha == pytest.approx(1)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ([coded("a"), coded("a")], "two files of the coder 'a'"),
        ([coded("a"), coded("b", labels=["help"])], "different codebooks"),
        ([coded("a"), coded("b", steps=8)], "different numbers of steps"),
    ],
)
def test_files_must_fit_together(files: list[Annotations], message: str) -> None:
    with pytest.raises(RobotouilleError, match=message):
        list(agreement(files))


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ([], "at least 1"),
        ([{"id": "a", "title": "A", "key": " "}], "the page uses the key"),
        ([{"id": "a", "title": "A", "key": "ab"}], "at most 1"),
        (
            [{"id": "a", "title": "A", "key": "a"}, {"id": "b", "title": "B", "key": "A"}],
            "two labels have the key 'a'",
        ),
    ],
)
def test_codebooks_are_checked(tmp_path: Path, labels: list[Any], message: str) -> None:
    file = tmp_path / "codebook.json"
    file.write_text(json.dumps({"labels": labels}))
    with pytest.raises(RobotouilleError, match=message):
        read_codebook(file)


def test_codebook_names_its_schema(tmp_path: Path) -> None:
    file = tmp_path / "codebook.json"
    labels = [{"id": "a", "title": "A", "key": "a"}]
    file.write_text(json.dumps({"$schema": "schemas/codebook.json", "labels": labels}))
    assert [label.id for label in read_codebook(file).labels] == ["a"]


def test_annotations_are_checked(tmp_path: Path) -> None:
    file = tmp_path / "labels.json"
    good = coded("a", (1, 2)).model_dump(mode="json")
    file.write_text(json.dumps(good))
    assert read_annotations(file) == coded("a", (1, 2))
    for row, message in (
        ({"label": "help", "first": 2, "last": 1}, "before its first step"),
        ({"label": "help", "first": 2, "last": 10}, "of a recording of 9 steps"),
        ({"label": "other", "first": 2, "last": 2}, "not in the codebook"),
    ):
        file.write_text(json.dumps({**good, "annotations": [row]}))
        with pytest.raises(RobotouilleError, match=message):
            read_annotations(file)


def test_command_prints_a_table(tmp_path: Path) -> None:
    files = []
    for each in (coded("meg", (1, 1), (8, 8)), coded("owen", (0, 2), (5, 5))):
        files.append(tmp_path / f"{each.coder}.json")
        files[-1].write_text(each.model_dump_json())
    done = CliRunner().invoke(app, ["replay", "agreement", *map(str, files)])
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0] == ["label", "coders", "steps", "used", "kappa", "alpha"]
    assert lines[1] == ["help", "2", "10", "30.0%", "0.09", "0.10"]
    assert lines[2] == ["wait", "2", "10", "0.0%", "-", "-"]


def test_codebook_model_keeps_its_order() -> None:
    rows = [{"id": str(n), "title": str(n), "key": str(n)} for n in range(3)]
    found = Codebook.model_validate({"labels": rows})
    assert [label.id for label in found.labels] == ["0", "1", "2"]
