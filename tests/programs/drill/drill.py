"""The drill itself: play, kill the server, restart it, and finally check that nothing is lost."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.programs.drill.accidents import ALL_ACCIDENTS, KILLED, PHASES
from tests.programs.drill.crowd import Crowd
from tests.programs.drill.moments import Kill, When, draw_kills
from tests.programs.drill.server import ServerProcess, free_port
from tests.programs.drill.verdict import Verdict, judge

__all__ = ["Plan", "Result", "missing_kills", "run_drill"]

LISTEN_SECONDS = 60.0
"""Seconds after which a server that does not listen has failed."""
WARM_UP_SECONDS = 60.0
"""Seconds after which the first kill no longer waits for all episodes to start."""
MOST, BACK_SECONDS = 0.8, 8.0
"""Share of players to wait for before a kill during play, and the longest wait in seconds."""
PEOPLE_SECONDS = 30.0
"""Seconds after which a kill during play no longer waits for the games of all people to run."""
EVENT_SECONDS = 4.0
"""Seconds after which a kill no longer waits for an episode to start or end."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Amount of play and kills. `kills` counts only SIGKILLs; SIGTERMs are sent in addition.
    `steps` bounds the step limits of episodes. `patience` is the number of seconds that episodes
    have to end after the last kill. With `all_accidents`, more kills come in phases of pages' games
    in which the server has not been killed, and play goes on until each accident has happened in
    each phase, for at most `accident_seconds`.
    """

    kills: int = 100
    games: int = 50
    windows: int = 0
    pages: int = 0
    processes: int = 3
    seed: int = 1
    steps: tuple[int, int] = (30, 150)
    patience: float = 300.0
    server_flags: tuple[str, ...] = ()
    all_accidents: bool = False
    accident_seconds: float = 1800.0


@dataclass(slots=True)
class Result:
    """Results of the drill, with times in seconds."""

    plan: Plan
    kills: Counter[str] = field(default_factory=Counter)
    signals: Counter[str] = field(default_factory=Counter)
    lives: int = 0
    seconds: float = 0.0
    start_seconds: list[float] = field(default_factory=list)
    stop_seconds: list[float] = field(default_factory=list)
    back_seconds: list[float] = field(default_factory=list)
    absence_seconds: list[float] = field(default_factory=list)
    restored: list[int] = field(default_factory=list)
    told: dict[str, int] = field(default_factory=dict)
    pictures: int = 0
    clicks: int = 0
    accidents: Counter[str] = field(default_factory=Counter)
    verdict: Verdict = field(default_factory=Verdict)
    faults: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        return not self.faults and self.verdict.games > 0


async def run_drill(plan: Plan, folder: Path, say: Callable[[str], None]) -> Result:
    """Run a drill in an empty folder and report progress through `say`."""
    evidence = folder / "told"
    evidence.mkdir(parents=True)
    result = Result(plan)
    server = ServerProcess(folder, free_port(), result.faults, *plan.server_flags)
    crowd = Crowd(server.url, evidence, plan.seed, plan.steps, result.faults)
    begun = time.monotonic()
    await server.start()
    try:
        await _listens(server)
        await crowd.start(plan.games, plan.processes, plan.windows, plan.pages)
        await crowd.all_play(plan.games + plan.windows + plan.pages, WARM_UP_SECONDS)
        await _Killing(server, crowd, result, say).all_kills(plan)
        await _finish(plan, server, crowd, result, say)
    finally:
        await crowd.stop()
        await server.kill(signal.SIGINT)
    result.seconds = time.monotonic() - begun
    say("comparing recordings with the messages that clients received")
    result.verdict = judge(folder / "recordings", evidence)
    _sum_up(server, crowd, result)
    return result


class _Killing:
    """Kills and restarts of the server, each with a line of progress."""

    def __init__(
        self, server: ServerProcess, crowd: Crowd, result: Result, say: Callable[[str], None]
    ) -> None:
        self._server, self._crowd, self._result, self._say = server, crowd, result, say
        self._reported = 0

    async def all_kills(self, plan: Plan) -> None:
        kills = draw_kills(plan.seed, plan.kills)
        for number, kill in enumerate(kills, 1):
            await _moment(kill, self._server, self._crowd)
            await self._kill(f"kill {number:3} of {len(kills)}", kill)
        for phase in PHASES if plan.all_accidents else ():
            if self._crowd.accidents[f"{KILLED} {phase}"]:
                continue
            await _listens(self._server)
            await self._crowd.page_is(phase, plan.patience)
            await self._kill(f"kill in phase {phase}", Kill(When.EVENT, 0.0, signal.SIGKILL))

    async def _kill(self, title: str, kill: Kill) -> None:
        crowd, result = self._crowd, self._result
        there, playing = len(crowd.present), len(crowd.playing)
        crowd.killed(time.monotonic())
        await self._server.kill(kill.signal)
        result.kills[f"{kill.signal.name} {kill.when.value}"] += 1
        result.signals[kill.signal.name] += 1
        self._say(
            f"{title}: {kill.signal.name} {kill.when.value:9}"
            f" {there} of {playing} players were connected,"
            f" {sum(crowd.ended.values())} seats have finished"
        )
        for fault in result.faults[self._reported :]:
            self._say(f"  ! {fault[:1000]}")
        self._reported = len(result.faults)
        await self._server.start()


async def _moment(kill: Kill, server: ServerProcess, crowd: Crowd) -> None:
    """Wait until the time of a kill."""
    if kill.when is not When.STARTING:
        await _listens(server)
    if kill.when is When.PLAYING:
        await crowd.most_are_back(MOST, BACK_SECONDS)
        await crowd.people_play(PEOPLE_SECONDS)
    if kill.when is When.EVENT:
        crowd.turn_of_events.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(crowd.turn_of_events.wait(), EVENT_SECONDS)
    await asyncio.sleep(kill.delay)


async def _listens(server: ServerProcess) -> None:
    try:
        await asyncio.wait_for(server.listening.wait(), LISTEN_SECONDS)
    except TimeoutError:
        raise RuntimeError(f"life {server.lives} does not listen; see {server.folder}") from None


async def _finish(
    plan: Plan, server: ServerProcess, crowd: Crowd, result: Result, say: Callable[[str], None]
) -> None:
    await _listens(server)
    if plan.all_accidents:
        wanted = ALL_ACCIDENTS | {f"{KILLED} {phase}" for phase in PHASES}
        missing = await crowd.have_accidents(wanted, plan.accident_seconds)
        result.faults += [f"no accident of a page: {accident}" for accident in sorted(missing)]
    crowd.finish()
    say(f"{len(crowd.playing)} bots play their episodes to the end")
    if not await crowd.finished(plan.patience):
        result.faults.append(f"episodes have not ended {plan.patience:g} s after the last kill")
        result.faults += [f"still playing: {situation}" for situation in crowd.situations]


def _sum_up(server: ServerProcess, crowd: Crowd, result: Result) -> None:
    result.lives = server.lives
    result.start_seconds, result.stop_seconds = server.start_seconds, server.stop_seconds
    result.restored = server.restored
    result.back_seconds = [o.seconds for o in crowd.outages if o.seconds is not None]
    result.absence_seconds = crowd.absences
    result.told = crowd.ended
    result.pictures, result.clicks = crowd.pictures, crowd.clicks
    result.accidents = crowd.accidents
    result.faults += result.verdict.faults
    result.faults += missing_kills(result.plan, result.verdict)


def missing_kills(plan: Plan, verdict: Verdict) -> list[str]:
    """Return a fault for each kind of players whose games were never interrupted during play."""
    sizes = {"bots": plan.games, "windows": plan.windows, "pages": plan.pages}
    return [
        f"no restart of the server fell into play of {kind}"
        for kind, size in sizes.items()
        if plan.kills and size and not verdict.restarted[f"{kind} running"]
    ]
