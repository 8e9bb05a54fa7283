"""The page on the Python API has every name that a user needs."""

from __future__ import annotations

import re
from collections.abc import Iterator

import robotouille
from robotouille import Attempt, State, Step, Task, World, planning, replay
from robotouille.planning import SearchResult
from robotouille.replay import Measures, SeatMeasures, Transition
from robotouille.world.arrays.encoding import Encoding
from tests.support.pages import read

CLASSES = [
    *(State, World, Step, Attempt, Task),
    *(SearchResult, Transition, Measures, SeatMeasures, Encoding),
]


def names() -> Iterator[str]:
    for face in (robotouille, planning, replay):
        yield from face.__all__
    for each in CLASSES:
        yield from (name for name in vars(each) if not name.startswith("_"))


def test_every_name_is_on_the_page() -> None:
    page = read("api.md")
    assert [name for name in sorted(set(names())) if not re.search(rf"\b{name}\b", page)] == []
