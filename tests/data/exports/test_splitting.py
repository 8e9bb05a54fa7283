"""Nobody is in two parts, and the parts are as large as may be."""

from __future__ import annotations

import random

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl

from robotouille_data.exports.splitting import split
from tests.support.random_study import PAIRS, ROUNDS, Write, manifest

SHARES = {"train": 0.5, "test": 0.5}


def test_groups_stay_together_and_shares_are_near() -> None:
    rng, together, number = random.Random(1), [], 0
    for _ in range(200):
        size = rng.choice([1, 1, 1, 2, 3, 10])
        together.append(tuple(range(number, number + size)))
        number += size
    parts = split(together, {"train": 0.8, "test": 0.2})
    assert sorted(parts["train"] + parts["test"]) == list(range(number))
    for members in together:
        assert len({name for name, part in parts.items() if set(members) & set(part)}) == 1
    assert abs(len(parts["test"]) / number - 0.2) < 0.01
    rng.shuffle(together)
    assert split(together, {"train": 8, "test": 2}) == parts


@pytest.mark.parametrize("label", ["pair", "no such label"])
def test_nobody_is_in_both_parts(write: Write, label: str) -> None:
    """Pairs share a label and participants; one of them alone would do."""
    folder = write(split=SHARES, split_by=label)
    told = manifest(folder)["split"]
    assert (told["groups"], told["episodes"]) == (PAIRS, {"train": 4, "test": 4})
    people = [
        set(pl.read_parquet(folder / part / "events.parquet").filter(kind="roster")["name"]) - {""}
        for part in SHARES
    ]
    assert people[0]
    assert people[1]
    assert not people[0] & people[1]
    rows = [len(pl.read_parquet(folder / part / "episodes.parquet")) for part in SHARES]
    assert sum(rows) == PAIRS * ROUNDS


def test_a_label_holds_episodes_together_that_share_nobody(write: Write) -> None:
    folder = write(split=SHARES, split_by="consent")
    assert manifest(folder)["split"]["episodes"] == {"train": 6, "test": 2}
