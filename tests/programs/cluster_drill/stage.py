"""A cluster with players on which drills run one after the other, and the comparison at the end."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tests.programs.cluster_drill.cluster import CUT_OFF, Cluster, Node, running_cluster
from tests.programs.cluster_drill.directory import Observer, observing
from tests.programs.drill.crowd import Crowd
from tests.programs.drill.report import spread, verdict_rows
from tests.programs.drill.verdict import Verdict, judge

__all__ = ["Drill", "Plan", "Result", "Stage", "run_drills"]

WARM_UP_SECONDS = 90.0
LOOK_SECONDS = 0.02
ACT_SECONDS = 10.0
"""Seconds in which players must act again."""
SHARE = 0.99
"""Share of the players who must."""
PATIENCE = 20.0
"""Seconds to wait for the others, for the figures."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Size of the drills.

    Attributes:
        games: The episodes at the same time.
        away: The seconds for which nodes are stopped or cut off.
        rounds: The rolling restarts.
        mix: The kinds of episodes; see `games.MIXES`.
        rate: Their steps per second, or 0 for those of the mix. Few cores carry few steps.
        steps: The bounds of the episodes' step limits.
        patience: The seconds for which the last episodes may go on.
        timed: True if slow players, late steps and takeovers of living nodes are violations.
            Otherwise they are figures only, because other programs may keep the machine busy, and
            drills wait for conditions, not for a number of seconds.
    """

    games: int = 100
    nodes: int = 3
    away: float = 20.0
    rounds: int = 10
    processes: int = 2
    seed: int = 1
    steps: tuple[int, int] = (150, 600)
    mix: str = "random"
    rate: float = 0.0
    patience: float = 300.0
    timed: bool = True


@dataclass(slots=True)
class Result:
    """Figures and faults of one drill."""

    rows: list[tuple[str, str]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    verdict: Verdict = field(default_factory=Verdict)

    @property
    def ok(self) -> bool:
        return not self.faults


class Stage:
    """Surroundings of a drill.

    Attributes:
        last: True during the last drill.
    """

    def __init__(
        self,
        plan: Plan,
        cluster: Cluster,
        crowd: Crowd,
        observer: Observer,
        evidence: Path,
        say: Callable[[str], None],
    ) -> None:
        self.plan = plan
        self.say = say
        self.cluster = cluster
        self.crowd = crowd
        self.observer = observer
        self.evidence = evidence
        self.result = Result()
        self.last = False
        self._starting: list[asyncio.Task[None]] = []

    def failed(self) -> None:
        """Start no more episodes after the last failure, unless the drills are timed."""
        if self.last and not self.plan.timed:
            self.crowd.finish()

    def limit(self, seconds: float) -> float:
        """Return how long to wait for something that should take at most `seconds`."""
        return seconds if self.plan.timed else max(seconds, self.plan.patience)

    def row(self, name: str, value: str) -> None:
        """Add a figure."""
        self.result.rows.append((name, value))

    def fault(self, text: str) -> None:
        """Add a violation."""
        self.result.faults.append(text)

    async def busiest(self) -> Node:
        """Return the node with the most episodes that are played; wait until there are some."""
        deadline = time.monotonic() + self.limit(WARM_UP_SECONDS)
        while True:
            node = max(self.cluster.nodes, key=lambda node: len(self.played_at(node)))
            if self.played_at(node) or time.monotonic() > deadline:
                return node
            await asyncio.sleep(LOOK_SECONDS)

    def restart(self, node: Node) -> None:
        """Start a process of a node while the drills go on."""
        self._starting.append(asyncio.create_task(node.start()))

    async def all_started(self) -> None:
        """Wait until the nodes that were started again have joined."""
        starting, self._starting = self._starting, []
        await asyncio.gather(*starting)

    def played_at(self, node: Node) -> set[str]:
        """Return the episodes of a node that are played."""
        return self.observer.episodes_of(node.url) & set(self.crowd.episodes.values())

    def players_of(self, episodes: set[str]) -> set[str]:
        """Return the players of episodes."""
        return {who for who, episode in self.crowd.episodes.items() if episode in episodes}

    async def taken_over(self, episodes: set[str], since: float, seconds: float) -> None:
        """Wait until other nodes have taken episodes over, and add the times as a figure."""
        left = await self.observer.lost(episodes, self.limit(seconds))
        times = self.observer.taken_over_at(episodes, since)
        self.row("failure → episodes taken over", spread([at - since for at in times.values()]))
        if left:
            self.fault(f"{len(left)} of {len(episodes)} episodes were not taken over: {left}")

    async def act_again(
        self, name: str, players: set[str], since: float, *, bound: bool = True
    ) -> None:
        """Wait until players act after a mark, and add the times as a figure.

        Args:
            name: The name of the figure.
            players: Those who must act.
            since: The moment of the failure.
            bound: Require it within `ACT_SECONDS`.
        """
        missing = await self.crowd.all_act(players, self.limit(ACT_SECONDS + PATIENCE))
        acted = {who: at - since for who, at in self.crowd.acted.items() if who in players}
        players = missing | acted.keys()
        self.row(name, spread(list(acted.values())))
        slow = sum(seconds > ACT_SECONDS for seconds in acted.values()) + len(missing)
        if bound and self.plan.timed and slow > (1 - SHARE) * len(players):
            late = [who for who, seconds in acted.items() if seconds > ACT_SECONDS]
            self.fault(
                f"{slow} of {len(players)} players did not act again within {ACT_SECONDS:g} s: "
                f"late {sorted(late)[:8]}, not at all {sorted(missing)[:8]}"
            )
        elif missing:
            self.fault(f"{len(missing)} players never acted again: {sorted(missing)[:8]}")


Drill = Callable[[Stage], Awaitable[None]]


@asynccontextmanager
async def _stage(
    plan: Plan, folder: Path, say: Callable[[str], None], links: bool
) -> AsyncIterator[Stage]:
    evidence = folder / "told"
    evidence.mkdir(parents=True)
    async with AsyncExitStack() as stack:
        running = running_cluster(folder, plan.nodes, links=links, started=False)
        cluster = await stack.enter_async_context(running)
        crowd = Crowd(
            cluster.url, evidence, plan.seed, plan.steps, [], mix=plan.mix, rate=plan.rate
        )
        stack.push_async_callback(crowd.stop)
        if not plan.timed:
            cluster.allow(*CUT_OFF)
        # Players look for a node until there is one. Timed games begin on all nodes.
        starting = [cluster.start(), crowd.start(plan.games, plan.processes, 0)]
        if plan.timed:
            for step in starting:
                await step
        else:
            await asyncio.gather(*starting)
        observer = await stack.enter_async_context(observing(cluster.nats.urls))
        stage = Stage(plan, cluster, crowd, observer, evidence, say)
        await crowd.all_play(plan.games, stage.limit(WARM_UP_SECONDS))
        yield stage


async def run_drills(
    plan: Plan,
    drills: dict[str, Drill],
    folder: Path,
    say: Callable[[str], None],
    *,
    links: bool,
) -> dict[str, Result]:
    """Run drills with the same players on one cluster.

    The last result, `comparison`, compares what all clients were told with the recordings.
    """
    results: dict[str, Result] = {}
    async with _stage(plan, folder, say, links) as stage:
        say(f"{len(stage.crowd.playing)} players in {stage.crowd.opened} episodes")
        for name, drill in drills.items():
            stage.result = results[name] = Result()
            stage.last = name == list(drills)[-1]
            begun = time.monotonic()
            await drill(stage)
            _take_faults(stage)
            say(f"{name}: {time.monotonic() - begun:.1f} s, {len(results[name].faults)} violations")
        stage.result = results["comparison"] = Result()
        await _finish(stage, say)
    return results


def _take_faults(stage: Stage) -> None:
    """Attribute what processes have reported to the drill that runs."""
    crowd = stage.crowd.faults
    stage.result.faults += [*crowd, *stage.cluster.faults]
    crowd.clear()
    for node in stage.cluster.nodes:
        node.faults.clear()


async def _finish(stage: Stage, say: Callable[[str], None]) -> None:
    crowd = stage.crowd
    crowd.finish()
    say(f"{len(crowd.playing)} players play their episodes to the end")
    if not await crowd.finished(stage.plan.patience):
        stage.fault(f"{sorted(crowd.playing)} still play; {crowd.situations}")
    await stage.all_started()
    await stage.cluster.kill(signal.SIGINT)
    _take_faults(stage)
    say("comparing recordings with the messages that clients received")
    folders = [node.recordings for node in stage.cluster.nodes]
    verdict = await asyncio.to_thread(judge, folders, stage.evidence)
    stage.result.verdict = verdict
    stage.result.rows += verdict_rows(verdict)
    stage.result.faults += verdict.faults
    if verdict.lost:
        stage.fault(f"players lost their seats: {verdict.lost}")
    if not verdict.games:
        stage.fault("no episode was compared")
