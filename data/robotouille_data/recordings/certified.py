"""How many steps the shipped certificates prove to be the fewest."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any

import msgpack

from robotouille.certification.certificate import content_hash
from robotouille.resources import data_folder

__all__ = ["fewest_steps"]


def fewest_steps(task: Mapping[str, Any]) -> int | None:
    """Of a recorded task; None where no shipped certificate says."""
    return _fewest_steps(msgpack.packb(task))


@lru_cache(maxsize=64)
def _fewest_steps(packed: bytes) -> int | None:
    """A certificate calls the task by its file: `01_cheese_sandwich`, recordings also by its
    folder. The hash takes longer than a hundred steps, and many episodes are of one task."""
    task = msgpack.unpackb(packed)
    name = str(task["name"]).rpartition("/")[2]
    text = json.dumps({**task, "name": name}, sort_keys=True, separators=(",", ":"))
    return _certified().get(content_hash(text.encode()))


@cache
def _certified() -> dict[str, int]:
    """The lengths of the proven shortest plans, by the content hash of their tasks."""
    problems = data_folder("problems")
    rows = json.loads((problems / "generated/manifest.json").read_bytes())["instances"]
    for path in problems.rglob("*.certificate.json"):
        if "generated" not in path.relative_to(problems).parts:
            rows.append(json.loads(path.read_bytes()))
    return {row["instance"]: row["length"] for row in rows if row["optimal"]}
