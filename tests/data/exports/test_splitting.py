"""Splits of exports without shared participants."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl
import sqlalchemy as sa

from robotouille.replay.compression import compress
from robotouille.replay.container import MAGIC, pack_frame, read_frames
from robotouille_data.database import database_url
from robotouille_data.exports.people import groups, split
from robotouille_data.indexing import index
from robotouille_data.query import reading
from robotouille_data.schema import EPISODES
from tests.support.random_play import random_stream
from tests.support.random_study import PAIRS, ROUNDS, Write, manifest

SHARES = {"train": 0.5, "test": 0.5}


def test_groups_stay_together_and_shares_are_approximated() -> None:
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
def test_parts_share_no_participant(write: Write, label: str) -> None:
    """Pairs share a label and participants. Each of them keeps a pair together."""
    folder = write(split=SHARES, split_by=label)
    received = manifest(folder)["split"]
    assert (received["groups"], received["episodes"]) == (PAIRS, {"train": 4, "test": 4})
    people = [
        set(pl.read_parquet(folder / part / "events.parquet").filter(kind="roster")["name"]) - {""}
        for part in SHARES
    ]
    assert people[0]
    assert people[1]
    assert not people[0] & people[1]
    rows = [len(pl.read_parquet(folder / part / "episodes.parquet")) for part in SHARES]
    assert sum(rows) == PAIRS * ROUNDS


def test_label_keeps_episodes_together(write: Write) -> None:
    folder = write(split=SHARES, split_by="consent")
    assert manifest(folder)["split"]["episodes"] == {"train": 6, "test": 2}


@pytest.mark.parametrize(
    ("first", "second", "reported", "together"),
    [
        (("Ada", ""), ("ADA", ""), "", True),
        (("Jos\u00e9", ""), ("JOSE\u0301", ""), "", True),
        (("Ada", "x1"), ("ada", ""), "", True),
        (("Ada", "x1"), ("Ada", "x2"), "", False),
        (("Ada", "x1"), ("Eve", "x1"), "", True),
        (("Ada", "x1"), ("Bob", "x2"), "ada", True),
        (("Ada", ""), ("Bob", ""), "Ada", True),
        (("Ada", ""), ("Bob", ""), "Eve", False),
    ],
)
def test_people_with_similar_names_are_in_one_part(
    tmp_path: Path, first: tuple[str, str], second: tuple[str, str], reported: str, together: bool
) -> None:
    """Names may differ in case, lack a token, or belong to a spectator who wrote a message."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    for number, person in enumerate((first, second)):
        people = [person, (f"Other{number}", f"o{number}")]
        frames = list(read_frames(random_stream(number, people=people)))
        if reported and number:
            note = {"note": "said", "t": 0, "name": reported, "player": "", "text": "well done"}
            frames.insert(-1, {"kind": "notes", "notes": [note]})
        stream = MAGIC + b"".join(map(pack_frame, frames))
        (folder / f"{number}.rbt").write_bytes(compress(stream))
    url = database_url(None, folder)
    assert index(url, [folder]).faults == {}
    with reading(url) as connection:
        ids = list(connection.scalars(sa.select(EPISODES.c.id)))
        assert len(groups(connection, ids, "pair")) == (1 if together else 2)
