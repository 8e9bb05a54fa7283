"""The shipped bots."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille import World
from robotouille.errors import FileError
from robotouille_client.bots.kinds import BotKind, policy_maker


def test_huge_plan_file_is_not_read(tmp_path: Path) -> None:
    plan = tmp_path / "huge.plan"
    plan.write_bytes(b"\n" * 5_000_000)
    make = policy_maker(BotKind.SCRIPTED, plan=plan)
    with pytest.raises(FileError, match="longer than 4,194,304 bytes"):
        make(World("synchronous/01").initial, "robot1")
