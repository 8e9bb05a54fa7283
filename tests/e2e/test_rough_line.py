"""A window on a connection that delays packets by up to 150 ms and loses 3 % of them.

The server runs in a network namespace, with the kernel's TCP. The window has no screen.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.scene import scene
from robotouille_client import Game, connect
from robotouille_client.window.drawing.kitchen.spots import Motion
from robotouille_client.window.sources.playout import MAX_DELAY, MAX_RATE
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.view import View
from tests.support.processes import process
from tests.support.unreliable_link import UnavailableError, UnreliableLink, unreliable_link
from tests.support.window_play import headless_window

pytestmark = [pytest.mark.process, pytest.mark.slow]

RATE, STEPS = 5.0, 45
JITTER, LOSS = 0.15, 0.03
MAX_RETRANSMISSION = 1.0
"""Seconds within which the kernel has resent lost packets, even those lost twice."""
SLACK = 0.05
"""Maximum difference in seconds between the window's time and the recorded one."""


@dataclass(frozen=True, slots=True)
class Seen:
    """The time, step and player position of one frame."""

    at: float
    position: float
    place: tuple[float, float]


class Walker:
    """Source that always walks to the farthest station and records each view.

    `arrivals` has the time at which each step arrived.
    """

    finished = False

    def __init__(self, source: RemoteSource, game: Game, now: Callable[[], float]) -> None:
        self._source, self._game, self._now = source, game, now
        self._motion = Motion(game.world.floor)
        self.seen: list[Seen] = []
        self.arrivals: dict[int, float] = {}
        self.over: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def view(self) -> View:
        view = self._source.view()
        placed = scene(view.state)
        before = None if view.previous is None else scene(view.previous)
        poses = self._motion.poses(view.state, placed, before, view.step, view.phase)
        self.seen.append(Seen(self._now(), view.step + view.phase, poses["robot1"].at))
        if self._game.step not in self.arrivals:
            self.arrivals[self._game.step] = self._game.step_time
            self._walk()
        if self._game.step >= STEPS and not self.over.done():
            self.over.set_result(None)
        return view

    def _walk(self) -> None:
        """Choose a new target after arriving."""
        state, world = self._game.state, self._game.world
        here = scene(state)["robot1"].at
        ways = {a: there for a in state.actions("robot1") if (there := a.destination)}
        if self._game.running and here and ways and not state.busy_steps("robot1"):
            self.act(max(ways, key=lambda action: world.floor.distance(here, ways[action])))

    def act(self, action: GroundAction) -> None:
        self._source.act(action)

    def say(self, text: str) -> None:
        self._source.say(text)


@pytest.fixture
def line() -> Iterator[UnreliableLink]:
    try:
        with unreliable_link(delay=0.01, jitter=JITTER, loss=LOSS, seed=3) as link:
            yield link
    except UnavailableError as error:
        pytest.skip(str(error))


async def test_window_is_smooth_on_an_unreliable_connection(
    line: UnreliableLink, tmp_path: Path
) -> None:
    flags = ("--host", line.address, "--mode", "realtime", "--step-rate", str(RATE), "--seats", "1",
             "--task", "asynchronous/09", "--timing", "people", "--countdown", "0")  # fmt: skip
    with process(tmp_path, *flags, prefix=line.prefix) as (_, url, code):
        async with connect(url, name="ada", kind="human") as client:
            game, now = await client.join(code), asyncio.get_running_loop().time
            walker = Walker(RemoteSource(game, now, client.connected.is_set), game, now)
            window = headless_window((640, 360), clock=now)
            showing = asyncio.create_task(window.run(walker, linger=None))
            async with asyncio.timeout(60):
                await walker.over
            showing.cancel()
    assert line.lost > 0 and line.carried > STEPS
    moves = list(itertools.pairwise(walker.seen))
    for before, after in moves:
        advance, passed = after.position - before.position, after.at - before.at
        assert 0.0 <= advance <= MAX_RATE * RATE * (passed + SLACK), "never back, and no leap"
        assert _distance(before.place, after.place) < max(1.0, MAX_RATE * RATE * passed)
    assert sum(_distance(a.place, b.place) for a, b in moves) > STEPS / 4, "somebody walked"
    quickest = min(at - step / RATE for step, at in walker.arrivals.items())
    behind = sorted(each.at - quickest - each.position / RATE for each in walker.seen)
    assert behind[len(behind) // 2] < MAX_DELAY + JITTER
    assert behind[-1] < MAX_DELAY + JITTER + MAX_RETRANSMISSION


def _distance(one: tuple[float, float], other: tuple[float, float]) -> float:
    return abs(one[0] - other[0]) + abs(one[1] - other[1])
