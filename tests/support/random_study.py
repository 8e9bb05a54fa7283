"""Recordings of a study in which pairs play several rounds in two conditions."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from robotouille.replay.compression import compress
from tests.support.random_play import random_stream

__all__ = ["PAIRS", "ROUNDS", "Write", "manifest", "write_random_study"]

Write = Callable[..., Path]
"""Function that writes an export in a format, with further options, and returns its folder."""

PAIRS, ROUNDS = 4, 2


def write_random_study(folder: Path, *, steps: int = 20) -> None:
    """Write `ROUNDS` recordings for each of `PAIRS` pairs. The last pair has not consented, and its
    participants have only names.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for pair in range(PAIRS):
        known = pair < PAIRS - 1
        people = [(f"Ada{pair}", f"x{pair}a" * known), (f"Bob{pair}", f"x{pair}b" * known)]
        for number in range(ROUNDS):
            labels = {
                "pair": f"pair{pair}",
                "condition": "ab"[number],
                "consent": "yes" if known else "no",
            }
            seed = ROUNDS * pair + number
            stream = random_stream(seed, steps=steps, labels=labels, people=people)
            (folder / f"random{seed}.rbt").write_bytes(compress(stream))


def manifest(folder: Path) -> dict[str, Any]:
    """Return an export's manifest."""
    found: dict[str, Any] = json.loads((folder / "export.json").read_text())
    return found
