"""The drill's view of its bot processes: active players, connections and failures."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.programs.drill.accidents import ENTERING, KILLED

__all__ = ["Crowd", "Late", "Outage"]


LOOK_SECONDS = 0.05


@dataclass(slots=True)
class Outage:
    """A kill, the clients it disconnected, and the seconds until each returned."""

    at: float
    missing: set[str]
    back: dict[str, float] = field(default_factory=dict)
    interrupted: bool = False

    @property
    def seconds(self) -> float | None:
        """Return the time until the last client returned, or None if the next kill came first."""
        if self.missing or self.interrupted or not self.back:
            return None
        return max(self.back.values())


@dataclass(frozen=True, slots=True)
class Late:
    """A step of a real-time episode that came `seconds` after it was due."""

    at: float
    who: str
    seconds: float


class Crowd:
    """All bot processes together.

    Args:
        url: The address of the server, or several separated by commas.
        folder: The folder for the evidence.
        steps: The bounds of the episodes' step limits.
        faults: The list to which faults are appended.
        mix: The kinds of episodes; see `games.MIXES`.
        rate: The steps per second of the episodes, or 0 for those of the mix.

    Attributes:
        episodes: The episode of each player who plays.
        acted: When each player's first action after `mark` was applied.
        late: The late steps of real-time episodes.
        accidents: Numbers of accidents of pages by kind and phase.
    """

    def __init__(
        self,
        url: str,
        folder: Path,
        seed: int,
        steps: tuple[int, int],
        faults: list[str],
        *,
        mix: str = "all",
        rate: float = 0.0,
    ) -> None:
        self.playing: set[str] = set()
        self.present: set[str] = set()
        self.outages: list[Outage] = []
        self.absences: list[float] = []
        self.ended: dict[str, int] = {}
        self.faults = faults
        self.episodes: dict[str, str] = {}
        self.acted: dict[str, float] = {}
        self.late: list[Late] = []
        self._marked = 0.0
        self._reports = 0
        self._folder = folder
        self.situations: list[dict[str, Any]] = []
        self.opened = 0
        self._seats = self._joined = 0
        self.pictures = 0
        self.clicks = 0
        self.accidents: Counter[str] = Counter()
        self._people = 0
        self._phases: dict[str, str] = {}
        self._pages: set[str] = set()
        self.turn_of_events = asyncio.Event()
        self._lost_at: dict[str, float] = {}
        self._arguments = ["--url", url, "--folder", str(folder), "--seed", str(seed)]
        self._arguments += ["--min-steps", str(steps[0]), "--max-steps", str(steps[1])]
        self._arguments += ["--mix", mix, "--rate", str(rate)]
        self._processes: list[asyncio.subprocess.Process] = []
        self._readers: list[asyncio.Task[None]] = []
        self._finishing = self._stopping = False

    async def start(self, slots: int, processes: int, windows: int, pages: int = 0) -> None:
        """Start episodes in all slots, divided among processes, and start windows and pages."""
        self._people = windows + pages
        for number in range(min(processes, slots)):
            await self._begin("tests.programs.drill.players", range(number, slots, processes))
        for number in range(windows):
            await self._begin("tests.programs.drill.people", [number])
        for number in range(pages):
            await self._begin("tests.programs.drill.pages", [number])

    async def _begin(self, module: str, slots: Iterable[int]) -> None:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", module, *self._arguments, *map(str, slots),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=2**20,
            env={**os.environ, "ROBOTOUILLE_COMPILE": "0"}, start_new_session=True,
        )  # fmt: skip
        self._processes.append(process)
        self._readers.append(asyncio.create_task(self._read(process)))

    async def all_play(self, games: int, seconds: float) -> None:
        """Wait until the players of this many episodes have joined, or until the time is up."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._until(lambda: self.opened >= games)
                seats = self._seats
                await self._until(lambda: self._joined >= seats)

    async def _until(self, reached: Callable[[], bool]) -> None:
        while not reached():
            self.turn_of_events.clear()
            await self.turn_of_events.wait()

    async def most_are_back(self, share: float, seconds: float) -> None:
        """Wait until this share of the players is connected, or until the time is up."""
        deadline = time.monotonic() + seconds
        while len(self.present) < share * len(self.playing) and time.monotonic() < deadline:
            await asyncio.sleep(LOOK_SECONDS)

    async def people_play(self, seconds: float) -> None:
        """Wait until the games of all people are running, or until the time is up."""
        deadline = time.monotonic() + seconds
        while self._playing_people() < self._people and time.monotonic() < deadline:
            await asyncio.sleep(LOOK_SECONDS)

    def _playing_people(self) -> int:
        return sum(self._phases.get(who) == "running" for who in self.present)

    def _phases_of_pages(self) -> Iterator[str]:
        """Yield the phase of each page that the server knows or that enters."""
        for who in self._pages:
            phase = self._phases[who]
            if who in self.present or phase == ENTERING:
                yield phase

    async def page_is(self, phase: str, seconds: float) -> None:
        """Wait until the game of a page is in a phase, or until the time is up."""
        deadline = time.monotonic() + seconds
        while phase not in self._phases_of_pages() and time.monotonic() < deadline:
            await asyncio.sleep(LOOK_SECONDS)

    async def have_accidents(self, wanted: Set[str], seconds: float) -> set[str]:
        """Wait until all these accidents have happened; return those that have not."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._until(lambda: wanted <= self.accidents.keys())
        return wanted - self.accidents.keys()

    def finish(self) -> None:
        """Start no more episodes."""
        self._finishing = True
        for process in self._processes:
            _write(process, b"finish\n")

    async def finished(self, seconds: float) -> bool:
        """Wait for all episodes to end; after a timeout, collect `situations` of the others."""
        if not self._readers:
            return True
        _, late = await asyncio.wait(self._readers, timeout=seconds)
        if late:
            for process in self._processes:
                _write(process, b"report\n")
            await asyncio.wait(self._readers, timeout=3)
        return not late

    async def stop(self) -> None:
        """Kill the processes and their children."""
        self._stopping = True
        for process in self._processes:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        await asyncio.gather(*self._readers)

    def mark(self) -> None:
        """Observe in `acted` when each player acts again."""
        self.acted, self._marked = {}, time.monotonic()
        for process in self._processes:
            _write(process, b"mark\n")

    async def all_act(self, players: Iterable[str], seconds: float) -> set[str]:
        """Wait until all these players have acted since the mark; return those who have not.

        Players whose episode ends are not waited for.
        """
        waiting, deadline = set(players), time.monotonic() + seconds
        while True:
            waiting &= self.playing - self.acted.keys()
            if not waiting or time.monotonic() > deadline:
                return waiting
            await asyncio.sleep(LOOK_SECONDS)

    async def report(self, seconds: float = 5.0) -> list[dict[str, Any]]:
        """Return the situations of all players."""
        self.situations, self._reports = [], 0
        for process in self._processes:
            _write(process, b"report\n")
        deadline = time.monotonic() + seconds
        while self._reports < len(self._processes) and time.monotonic() < deadline:
            await asyncio.sleep(LOOK_SECONDS)
        return self.situations

    def killed(self, at: float) -> None:
        """Record that the server has just been killed."""
        if self.outages and self.outages[-1].missing:
            self.outages[-1].interrupted = True
        self.outages.append(Outage(at, set(self.playing)))
        self.accidents.update(f"{KILLED} {phase}" for phase in self._phases_of_pages())

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        path = self._folder.parent / f"players-{process.pid}.jsonl"
        with path.open("wb") as log:
            async for line in process.stdout:
                log.write(line)
                self._heed(json.loads(line))
        status = await process.wait()
        if status != 0 and not self._stopping:
            self.faults.append(f"a bot process ended with status {status}")

    def _heed(self, row: dict[str, Any]) -> None:
        who, at = row.get("who", ""), row["at"]
        match row["event"]:
            case "opened":
                self.opened += 1
                self._seats += row.get("seats", 0)
                self.turn_of_events.set()
            case "joined":
                self._joined += 1
                self.playing.add(who)
                self.episodes[who] = row["episode"]
                self.turn_of_events.set()
            case "back":
                self._back(who, at)
            case "lost":
                self.present.discard(who)
                self._lost_at[who] = at
            case "over":
                self._over(who, row["outcome"])
                self.clicks += row.get("clicks", 0)
            case "failed":
                self.faults.append(f"{who}: {row['error']}")
            case "accident":
                self.accidents[f"{row['how']} {row['phase']}"] += 1
                self.turn_of_events.set()
            case "phase":
                self._phases[who] = row["phase"]
                if row.get("page"):
                    self._pages.add(who)
                self.turn_of_events.set()
            case "pictured":
                self.pictures += 1
            case "acted" if row.get("marked", 0.0) >= self._marked > 0.0:
                self.acted[who] = at
            case "late":
                self.late.append(Late(at, who, row["seconds"]))
            case "situation":
                self.situations.append(row)
            case "reported":
                self._reports += 1

    def _back(self, who: str, at: float) -> None:
        self.present.add(who)
        lost = self._lost_at.pop(who, None)
        if lost is not None:
            self.absences.append(at - lost)
        if self.outages and who in self.outages[-1].missing and at > self.outages[-1].at:
            self.outages[-1].missing.discard(who)
            self.outages[-1].back[who] = at - self.outages[-1].at

    def _over(self, who: str, outcome: dict[str, Any]) -> None:
        self.playing.discard(who)
        self.episodes.pop(who, None)
        self._phases.pop(who, None)
        self._pages.discard(who)
        self.present.discard(who)
        if self.outages:
            self.outages[-1].missing.discard(who)
        reason = str(outcome.get("reason", "(not told)"))
        self.ended[reason] = self.ended.get(reason, 0) + 1
        self.turn_of_events.set()


def _write(process: asyncio.subprocess.Process, line: bytes) -> None:
    if process.returncode is None and process.stdin is not None:
        process.stdin.write(line)
