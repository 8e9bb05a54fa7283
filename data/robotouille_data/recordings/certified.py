"""How many steps the shipped certificates prove to be the fewest."""

from __future__ import annotations

import json
from functools import cache

from robotouille.resources import data_folder

__all__ = ["fewest_steps"]


def fewest_steps(digest: str) -> int | None:
    """Of the task with this content hash; None where no shipped certificate says."""
    return _certified().get(digest)


@cache
def _certified() -> dict[str, int]:
    problems = data_folder("problems")
    rows = json.loads((problems / "generated/manifest.json").read_bytes())["instances"]
    for path in problems.rglob("*.certificate.json"):
        if "generated" not in path.relative_to(problems).parts:
            rows.append(json.loads(path.read_bytes()))
    return {row["instance"]: row["length"] for row in rows if row["optimal"]}
