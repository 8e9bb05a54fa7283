"""Events of a game are documented and immutable."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

from robotouille_client import GameEvent

ROOT = Path(__file__).resolve().parents[2]


def test_all_events_are_documented() -> None:
    page = (ROOT / "docs/api.md").read_text("utf-8")
    table = page.partition("| event | when |")[2].partition("\n\n")[0]
    documented = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    assert set(documented) == {kind.__name__ for kind in get_args(GameEvent)}
