"""The drill's verdict on altered evidence and recordings."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille import State
from robotouille_client import connect
from robotouille_client.bots import RandomPolicy, play
from tests.programs.drill.verdict import judge
from tests.programs.drill.witness import Witness
from tests.support.servers import serving
from tests.support.virtual_time import run

Rows = list[list[Any]]
ADA, BOB = "ada", "bob"


def bot(_: State, player: str) -> RandomPolicy:
    return RandomPolicy(player, 1)


async def play_with_witnesses(folder: Path, *, restart_at: int | None = None) -> None:
    """Let two bots play an episode and record the messages that they receive.

    Another server continues the episode from the step `restart_at`.
    """
    (folder / "told").mkdir()
    task = "multi_agent/01_lettuce_burger"
    recordings = folder / "recordings"
    async with (
        AsyncExitStack() as stack,
        serving(recordings, task=task, max_steps=25) as server,
        connect(server.url, name=ADA) as one,
        connect(server.url, name=BOB) as other,
    ):
        created = await one.create(task)
        witnesses = []
        for client in (one, other):
            game = await client.join(created.code)
            witnesses.append(Witness(game, client.name, folder / "told"))
        async with asyncio.TaskGroup() as group:
            for witness in witnesses:
                group.create_task(play(witness.game, bot, threaded=False))
            if restart_at is not None:
                while game.step < restart_at:
                    await asyncio.sleep(0)
                await server.stop("restart", hand_over=True)
                await stack.enter_async_context(serving(recordings, port=server.port, seed=2))
        for witness in witnesses:
            await witness.close()


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("played")
    run(play_with_witnesses(folder))
    return folder


@pytest.fixture
def folder(played: Path, tmp_path: Path) -> Path:
    """Return a copy of an episode's files that a test may alter."""
    return shutil.copytree(played, tmp_path / "copy")


def faults(folder: Path) -> list[str]:
    return judge(folder / "recordings", folder / "told").faults


def change(folder: Path, alter: Callable[[Rows], Any], name: str = ADA) -> None:
    """Alter a client's evidence."""
    (path,) = (folder / "told").glob(f"*-{name}.jsonl")
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    alter(rows)
    path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")


def first(rows: Rows, kind: str) -> list[Any]:
    """Return the first row of a kind, or the first applied action."""
    return next(r for r in rows if r[0] == kind and (kind != "act" or (r[2] and r[3])))


def test_correct_evidence_has_no_faults(folder: Path) -> None:
    verdict = judge(folder / "recordings", folder / "told")
    assert verdict.faults == []
    assert (verdict.games, verdict.verified, verdict.steps) == (1, 1, 25)
    assert verdict.deltas == 50
    assert verdict.states > 50
    assert verdict.actions > 20
    assert verdict.chat == 12, "each sends three messages, and both receive them"
    assert verdict.unheard == 0


@pytest.mark.parametrize(
    ("kind", "field", "value", "fault"),
    [
        ("state", 2, "0" * 32, "had hash"),
        ("delta", 2, [[0, "dance"]], "contains [[0, 'dance']]"),
        ("delta", 1, 9999, "step 9999 is lost: the recording ends at 25"),
        ("delta", 3, [77, 78], "other sequence numbers"),
        ("delta", 4, [0], "rejected [0]"),
        ("said", 1, 999, "is lost"),
        ("said", 4, "something else", "recorded"),
        ("act", 4, 24, "applied in step"),
        ("act", 1, 10_000, "applied in step"),
        ("act", 2, ["dance"], "applied in step"),
        ("act", 3, False, "was rejected"),
        ("over", 1, {"reason": "goal"}, "ended with"),
    ],
)
def test_difference_is_found(
    folder: Path, kind: str, field: int, value: object, fault: str
) -> None:
    change(folder, lambda rows: first(rows, kind).__setitem__(field, value))
    found = faults(folder)
    assert len(found) == 1
    assert fault in found[0]
    assert ADA in found[0]


def test_restart_during_play_is_counted(tmp_path: Path) -> None:
    run(play_with_witnesses(tmp_path, restart_at=10))
    verdict = judge(tmp_path / "recordings", tmp_path / "told")
    assert verdict.faults == []
    assert verdict.restarted == {"bots running": 1}


def test_client_that_missed_the_end_is_found(folder: Path) -> None:
    change(folder, lambda rows: rows.pop(), BOB)
    (found,) = faults(folder)
    assert "the client never saw the end" in found


def test_missing_unclosed_and_damaged_recordings_are_found(folder: Path) -> None:
    (recording,) = (folder / "recordings").iterdir()
    content = recording.read_bytes()
    recording.write_bytes(content[:-20])
    (found,) = faults(folder)
    assert recording.name in found
    recording.rename(recording.with_name(f"{recording.name}.part"))
    left_behind, missing = faults(folder)
    assert "is left behind" in left_behind
    assert "has no recording" in missing


def test_recordings_of_several_nodes_must_agree(folder: Path) -> None:
    (recording,) = (folder / "recordings").iterdir()
    (folder / "other").mkdir()
    copy = Path(shutil.copy(recording, folder / "other"))
    folders = [folder / "recordings", folder / "other"]
    assert judge(folders, folder / "told").faults == []
    assert judge(folders, folder / "told").games == 1
    copy.write_bytes(recording.read_bytes()[:-20])
    (found,) = judge(folders, folder / "told").faults
    assert found == f"{recording.name} differs between two nodes"
