"""Join codes and ids come from the system's source of chance, so that nobody can guess them."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from robotouille_server import ServerSettings, serve
from tests.support.servers import raw
from tests.support.virtual_time import run

NAMES = ("session", "episode", "code")


def names(folder: Path, chance: random.Random | None = None) -> list[str]:
    """What a new server calls its first session and its first episodes."""

    async def main() -> list[str]:
        settings = ServerSettings(port=0, recordings=folder)
        async with serve(settings, randomness=chance) as server, raw(server, hello=False) as ada:
            hello = {"type": "hello", "protocol": 1, "name": "ada"}
            answers = [await ada.ask(hello, "welcome")]
            for _ in range(3):
                answers.append(await ada.ask({"type": "create"}, "created"))
            return [answer[name] for answer in answers for name in NAMES if name in answer]

    found: list[str] = run(main())
    return found


def test_servers_made_the_same_way_have_nothing_in_common(tmp_path: Path) -> None:
    one, other = names(tmp_path / "one"), names(tmp_path / "other")
    assert len(one) == len(other) == 7
    assert len({*one, *other}) == 14


def test_all_names_come_from_the_systems_chance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = names(tmp_path / "known", random.Random(7))
    assert names(tmp_path / "unknown") != known
    monkeypatch.setattr(random, "SystemRandom", lambda: random.Random(7))
    assert names(tmp_path / "system") == known
