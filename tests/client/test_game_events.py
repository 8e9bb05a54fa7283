"""What a game tells its participants is documented, and cannot be changed by them."""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import get_args

import pytest

from robotouille_client import ActResult, GameEvent, Over
from robotouille_client.sansio.game_events import Announced

ROOT = Path(__file__).resolve().parents[2]


def test_every_event_is_documented() -> None:
    page = (ROOT / "docs/api.md").read_text("utf-8")
    table = page.partition("| event | when |")[2].partition("\n\n")[0]
    documented = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    assert set(documented) == {kind.__name__ for kind in get_args(GameEvent)}


def test_events_are_values() -> None:
    assert Announced("hello") == Announced("hello")
    assert ActResult(True, 3) == ActResult(True, 3, (), "")
    with pytest.raises(FrozenInstanceError):
        Over({}).reason = "another"  # type: ignore[misc]
