"""Objects of published problems are called as the published builder calls them.

It sorts each list by (x, y), stable, and counts each kind in that order. Skipped where the
published files are absent.
"""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from robotouille import World, load_task

COMPAT = Path(__file__).resolve().parents[3] / "shared" / "compat"
LISTS = {"stations": "station", "items": "item", "containers": "container", "players": "player"}
FOLDERS = ("upstream/problems/synchronous", "upstream/problems/asynchronous",
           "upstream/problems/multi_agent", "published/instances_noisy")  # fmt: skip
PROBLEMS = [path for name in FOLDERS for path in sorted((COMPAT / name).rglob("*.json"))]
PROBLEMS = [path for path in PROBLEMS if path.name != "index.json"]


def published_names(objects: list[dict[str, Any]]) -> list[tuple[str, tuple[int, int], int]]:
    """Name, tile and stack level, in the published order."""
    numbers: Counter[str] = Counter()
    found = []
    for thing in sorted(objects, key=lambda o: (o["x"], o["y"])):
        numbers[thing["name"]] += 1
        name = f"{thing['name']}{numbers[thing['name']]}"
        found.append((name, (thing["x"], thing["y"]), thing.get("stack-level", 0)))
    return found


@pytest.mark.skipif(not PROBLEMS, reason="no published files beside the project")
@pytest.mark.parametrize("path", PROBLEMS, ids=lambda p: p.stem)
def test_names(path: Path) -> None:
    problem = json.loads(path.read_text())
    world = World(load_task(str(path)))
    for field, kind in LISTS.items():
        placed = [(o.name, o.tile, o.level) for o in world.placed if o.type == kind]
        assert placed == published_names(problem.get(field, []))
