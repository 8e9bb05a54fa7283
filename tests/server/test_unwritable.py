"""A file that cannot grow pauses its own episode, in a real process too, and nothing is lost."""

from __future__ import annotations

import asyncio
import errno
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest

from robotouille import ProtocolError
from robotouille.replay.recording import read_recording
from robotouille_client import Changed, Game, Heard, connect
from tests.support.disks import TroubledFolder
from tests.support.processes import process
from tests.support.servers import serving
from tests.support.virtual_time import run

resource = pytest.importorskip("resource", reason="limits of files are those of POSIX")
limited = pytest.mark.skipif(
    not hasattr(resource, "prlimit"), reason="limits of another process can be set on Linux only"
)

PATIENCE = 60
"""Seconds after which what a test waits for has not happened."""
TALK = [f"{number:02} " + "x" * 490 for number in range(30)]
ALONE: dict[str, Any] = {"task": "synchronous/01", "clock": "realtime", "max_steps": 100_000}


@asynccontextmanager
async def two_kitchens(url: str) -> AsyncIterator[tuple[Game, Game]]:
    """Two episodes that run, each with one player."""
    async with connect(url, name="ada") as ada, connect(url, name="bob") as bob:
        one = await ada.join((await ada.create(**ALONE)).code)
        two = await bob.join((await bob.create(**ALONE)).code)
        yield one, two


async def until(game: Game, reached: Callable[[Game], object]) -> list[Any]:
    """Take in events until something holds; those events."""
    events: list[Any] = []
    async with asyncio.timeout(PATIENCE):
        while not reached(game):
            events.append(await game.next_event())
    return events


async def further(game: Game, steps: int) -> list[Any]:
    step = game.step + steps
    return await until(game, lambda game: game.step >= step)


def let_files_grow_to(size: int, server: Popen[str]) -> None:
    """What is written beyond fails with EFBIG, of a longer piece after its first bytes."""
    hard = resource.prlimit(server.pid, resource.RLIMIT_FSIZE)[1]
    resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (size, hard))


def part_of(folder: Path, game: Game) -> Path:
    (file,) = folder.glob(f"*{game.episode}.rbt.part")
    return file


def stands_still(game: Game) -> bool:
    return game.paused and game.pause is not None and game.pause.reason == "storage"


def assert_whole(file: Path, events: list[Any], said: list[str]) -> None:
    """All that was shown or said is in the recording, and nothing was left out."""
    recording = read_recording(file)
    assert recording.verify().ok
    assert [note["text"] for note in recording.notes() if note["note"] == "said"] == said
    recorded = {step: state.digest for step, state in recording.states()}
    shown = {event.step: event.state.digest for event in events if isinstance(event, Changed)}
    assert list(shown) == list(range(min(shown), max(shown) + 1))
    assert shown.items() <= recorded.items()


def holds(file: Path) -> list[list[str]]:
    """Why time stood still, each time that changed."""
    return [note["holds"] for note in read_recording(file).notes() if "holds" in note]


async def talk(game: Game) -> list[Any]:
    """Say all of TALK, until it is heard and so written."""
    for text in TALK:
        game.say(text)
    events: list[Any] = []
    for text in TALK:
        while not (events and isinstance(events[-1], Heard) and events[-1].text == text):
            events.append(await game.next_event())
    return events


async def through_a_limit(url: str, server: Popen[str], folder: Path) -> tuple[str, str, list[Any]]:
    """Two kitchens, and a limit that the longer one's file reaches; their ids, and what it saw."""
    async with two_kitchens(url) as (long, short), asyncio.timeout(PATIENCE):
        seen = await talk(long)
        file = part_of(folder, long)
        let_files_grow_to(file.stat().st_size + 300, server)
        seen += await until(long, stands_still)
        size, step = file.stat().st_size, long.step
        await further(short, 50)
        assert not short.paused
        assert (long.step, stands_still(long), file.stat().st_size) == (step, True, size)
        assert read_recording(file).steps[-1]["step"] >= step, "shown, but not written"
        let_files_grow_to(resource.RLIM_INFINITY, server)
        seen += await until(long, lambda game: not game.paused)
        seen += await further(long, 10)
        return long.episode, short.episode, seen


@pytest.mark.process
@limited
def test_a_file_that_may_not_grow_pauses_its_episode_only(tmp_path: Path) -> None:
    """A limit between the sizes of two recordings stops the longer one until it is lifted."""
    flags = ("--step-rate", "20", "--messages-per-second", "1000")
    with process(tmp_path, *flags) as (server, url, _):
        long, short, seen = asyncio.run(through_a_limit(url, server, tmp_path))
        server.send_signal(signal.SIGINT)
        assert server.wait(timeout=PATIENCE) == 0
    (file,), (other,) = tmp_path.glob(f"*{long}.rbt"), tmp_path.glob(f"*{short}.rbt")
    assert_whole(file, seen, TALK)
    assert ["storage"] in holds(file)
    assert read_recording(other).verify().ok
    assert ["storage"] not in holds(other)


@pytest.mark.process
@limited
def test_no_episode_is_opened_that_cannot_be_recorded(tmp_path: Path) -> None:
    async def play(url: str, server: Popen[str]) -> str:
        async with connect(url, name="ada") as ada, asyncio.timeout(PATIENCE):
            let_files_grow_to(0, server)
            with pytest.raises(ProtocolError, match="cannot be written") as error:
                await ada.create(**ALONE)
            assert error.value.code == "server/recording"
            assert len(list(tmp_path.glob("*.part"))) == 1, "something is left of what failed"
            let_files_grow_to(resource.RLIM_INFINITY, server)
            game = await ada.join((await ada.create(**ALONE)).code)
            await further(game, 3)
            return game.episode

    with process(tmp_path, "--step-rate", "20") as (server, url, _):
        episode = asyncio.run(play(url, server))
        server.send_signal(signal.SIGINT)
        assert server.wait(timeout=PATIENCE) == 0
    (file,) = tmp_path.glob(f"*{episode}.rbt")
    assert read_recording(file).verify().ok


class OneBadFile(TroubledFolder):
    """A folder on a disk with a fault, under a single file."""

    bad = ""

    def before_append(self, name: str) -> None:
        if self.bad and self.bad in name:
            raise OSError(errno.EIO, "Input/output error")


def test_only_the_affected_episode_stands_still(tmp_path: Path) -> None:
    """In virtual time: the other one misses not a single step of its clock."""

    async def main() -> tuple[str, str, list[Any]]:
        disk = OneBadFile(tmp_path)
        async with serving(tmp_path, storage=disk, step_rate=10) as server:
            async with two_kitchens(server.url) as (broken, well):
                seen = await further(broken, 5)
                disk.bad = broken.episode
                seen += await until(broken, stands_still)
                step, begun = broken.step, asyncio.get_running_loop().time()
                await further(well, 100)
                assert asyncio.get_running_loop().time() - begun < 10.5
                assert (broken.step, well.paused, stands_still(broken)) == (step, False, True)
                assert server.metrics.failing._value.get() == 1
                disk.bad = ""
                seen += await until(broken, lambda game: not game.paused)
                seen += await further(broken, 5)
                assert server.metrics.failing._value.get() == 0
                return broken.episode, well.episode, seen

    broken, well, seen = run(main())
    (file,), (other,) = tmp_path.glob(f"*{broken}.rbt"), tmp_path.glob(f"*{well}.rbt")
    assert_whole(file, seen, [])
    assert ["storage"] in holds(file)
    assert ["storage"] not in holds(other)
