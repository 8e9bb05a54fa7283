"""The step limit of an episode: what was asked for, what the operator says, what people need."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille_client import connect
from tests.support.servers import serving
from tests.support.virtual_time import run

FIRST = "multi_agent/01"


@pytest.mark.parametrize(
    ("settings", "asked", "limit"),
    [
        ({}, {"clock": "realtime"}, 900),
        ({}, {"clock": "realtime", "step_rate": 10.0}, 1800),
        ({}, {"clock": "realtime", "max_steps": 70}, 70),
        ({"max_steps": 300}, {"clock": "realtime"}, 300),
        ({}, {"clock": "realtime", "timing": "benchmark"}, 500),
        ({}, {"clock": "lockstep"}, 500),
        ({}, {"clock": "lockstep", "timing": "people"}, 210),
        ({}, {"clock": "realtime", "task": "examples/pancakes"}, 500),
    ],
)
def test_limit(tmp_path: Path, settings: dict[str, Any], asked: dict[str, Any], limit: int) -> None:
    async def main() -> None:
        async with (
            serving(tmp_path, **settings) as server,
            connect(server.url, name="ada", kind="human") as ada,
        ):
            options = {"task": FIRST, **asked}
            created = await ada.create(options.pop("task"), **options)
            (info,) = [one for one in await ada.episodes() if one.code == created.code]
            assert info.max_steps == limit

    run(main())
