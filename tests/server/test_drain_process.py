"""Stopping a server process: running games may end first."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import urlsplit

import psutil
import pytest

from robotouille import GroundAction, ProtocolError, World, load_task
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from robotouille.replay.recording import Recording, read_recording
from robotouille_client import Game, GameEnded, connect
from tests.support.processes import process
from tests.support.worker_processes import workers

pytestmark = [pytest.mark.process, pytest.mark.slow]

TASK = "synchronous/01_cheese_sandwich"
DRAIN = ("--drain-seconds", "120")
SOON = 30
"""Seconds in which a process ends that waits for nothing: far fewer than it may drain."""

Moves = Sequence[GroundAction | None]


def the_plan() -> Moves:
    """Return the shipped plan of the task."""
    world = World(load_task(TASK))
    text = (data_folder("problems") / f"{TASK}.plan").read_text()
    return [action for (action,) in read_plan(text, world)]


def the_recording(folder: Path, ending: str) -> Recording:
    (file,) = folder.glob(f"*{ending}")
    recording = read_recording(file)
    assert recording.verify().ok
    return recording


async def turned_away(url: str) -> None:
    """Wait until new connections are refused."""
    where = urlsplit(url)
    for _ in range(600):
        with socket.socket() as probe:
            if probe.connect_ex((where.hostname, where.port)) != 0:
                return
        await asyncio.sleep(0.05)
    raise AssertionError(f"{url} still accepts connections")


async def ending(game: Game) -> GameEnded:
    async for event in game:
        if isinstance(event, GameEnded):
            return event
    raise AssertionError("the game did not end")


async def play_on(
    url: str, code: str, moves: Moves, last: int, received: Callable[[], None]
) -> tuple[str, GameEnded]:
    """Stop a server before a game's `last` moves; return why it opens no game, and how the game
    ends.
    """
    async with connect(url, name="ada", reconnect=False) as client:
        game = await client.join(code)
        for move in moves[:-last]:
            assert (await game.act(move)).applied
        received()
        await turned_away(url)
        with pytest.raises(ProtocolError) as refused:
            await client.create(TASK)
        for move in moves[-last:]:
            assert (await game.act(move)).applied
        return refused.value.code, await ending(game)


@pytest.mark.parametrize("reason", ["goal", "step_limit"])
def test_game_that_ends_soon_is_finished(tmp_path: Path, reason: str) -> None:
    moves = the_plan() if reason == "goal" else [None] * 5
    flags = ("--task", TASK, "--max-steps", str(len(moves)), *DRAIN)
    with process(tmp_path / "r", *flags) as (server, url, code):
        refused, over = asyncio.run(play_on(url, code, moves, 3, server.terminate))
        assert server.wait(timeout=SOON) == 0
    assert refused == "server/draining"
    assert over.outcome["reason"] == reason
    recording = the_recording(tmp_path / "r", ".rbt")
    assert recording.verify().complete
    assert recording.outcome == over.outcome
    assert not list((tmp_path / "r").glob("*.part"))
    assert len(recording.steps) == len(moves)


async def told_twice(url: str, received: Callable[[], None]) -> GameEnded:
    """Stop a server twice; return how its game ends."""
    async with asyncio.timeout(SOON), connect(url, name="ada", reconnect=False) as client:
        game = await client.join((await client.create(TASK)).code)
        assert (await game.act(None)).applied
        received()
        await turned_away(url)
        assert (await game.act(None)).applied
        received()
        return await ending(game)


def handed_over(over: GameEnded, folder: Path) -> bool:
    """Return whether a game was left unchanged for the next process."""
    files = {file.name: read_recording(file) for file in folder.iterdir()}
    (left,) = [recording for recording in files.values() if recording.steps]
    assert left.verify().ok
    return over.outcome == {} and left.outcome is None and len(left.steps) == 2


def test_second_signal_hands_over_at_once(tmp_path: Path) -> None:
    with process(tmp_path / "r", *DRAIN) as (server, url, _code):
        over = asyncio.run(told_twice(url, server.terminate))
        assert server.wait(timeout=SOON) == 0
    assert handed_over(over, tmp_path / "r")


def test_second_signal_reaches_workers(tmp_path: Path) -> None:
    with workers(tmp_path / "r", 2, *DRAIN) as (supervisor, port):
        over = asyncio.run(told_twice(f"ws://127.0.0.1:{port}", supervisor.terminate))
        assert supervisor.wait(timeout=SOON) == 0
    assert handed_over(over, tmp_path / "r")


def test_workers_let_their_games_end(tmp_path: Path) -> None:
    async def main(url: str, received: Callable[[], None]) -> tuple[str, GameEnded]:
        async with connect(url, name="host") as host:
            code = (await host.create(TASK, max_steps=5)).code
            return await play_on(url, code, [None] * 5, 3, received)

    with workers(tmp_path, 2, *DRAIN) as (supervisor, port):
        children = psutil.Process(supervisor.pid).children()
        refused, over = asyncio.run(main(f"ws://127.0.0.1:{port}", supervisor.terminate))
        assert supervisor.wait(timeout=SOON) == 0
        assert not [child for child in children if child.is_running()]
    assert refused == "server/draining"
    assert over.outcome["reason"] == "step_limit"
    recording = the_recording(tmp_path, ".rbt")
    assert recording.verify().complete
    assert recording.outcome == over.outcome
