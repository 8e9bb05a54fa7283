"""A long day: one server, many episodes, occasional faults, and a check of the memory."""

from __future__ import annotations

import asyncio
import gc
import random
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from robotouille.world.grounding.goal import Goal
from robotouille.world.grounding.successors import SuccessorTree
from robotouille.world.timers import TimerTable
from robotouille_server.rooms.substitutes.bots import BotWorld
from tests.programs.simulation.scenario import (
    FAULTS,
    DrawPlan,
    EpisodePlan,
    Scenario,
    draw_plan,
    draw_settings,
)
from tests.programs.simulation.simulation import Report, Simulation
from tests.programs.simulation.transport import Conditions

__all__ = ["Day", "simulate_day"]

HOUR = 3600.0
FAULT_EVERY = 15.0
GAME_PATIENCE = 2 * HOUR
REAL_TIME_ROOMS = 2
LOOKS = 24
WARM_HOURS = 4.0
"""Length below which memory is not checked, because new tasks and code still need space."""
GROWTH = 1.1
MARGIN = 20_000
"""Allocated blocks by which measurements may differ, because of episodes in progress."""


class Day(Simulation):
    """`rooms` simultaneous episodes, two of them in real time with five steps a second."""

    def __init__(self, seed: int, hours: float, report: Callable[[str], None], rooms: int) -> None:
        self.hours = hours
        self.rooms = rooms
        self.games = 0
        self.blocks: list[int] = []
        self._report = report
        super().__init__(seed, draw_scenario=self._scenario)

    def _scenario(self, chance: random.Random) -> Scenario:
        return Scenario(
            conditions=Conditions(latency=0.02, jitter=0.02),
            settings=draw_settings(chance),
            faults=dict.fromkeys(FAULTS, 1.0) | {"hand_over": 0.2, "fill_disk": 0.3},
            pause=FAULT_EVERY,
            trouble=self.hours * HOUR,
            patient_close=True,
        )

    async def course(self) -> None:
        self.server.boot()
        end = self.loop.time() + self.hours * HOUR
        rooms = [asyncio.ensure_future(self._room(number, end)) for number in range(self.rooms)]
        watch = asyncio.ensure_future(self._watch(end))
        await self.adversary.trouble()
        await asyncio.gather(*rooms, watch)
        await self.all_over()
        await self.nothing_kept()
        await self.shut_down()

    async def _room(self, number: int, end: float) -> None:
        """Play one episode after another."""
        chance = random.Random(f"{self.seed}/room/{number}")
        while self.loop.time() < end and not self.faults:
            self.games += 1
            plan = self._plan(number, chance)
            self.open(plan)
            await self._until_over(plan)
            self._forget(plan)
            if number >= REAL_TIME_ROOMS:
                await asyncio.sleep(chance.uniform(10, 600))

    def _plan(self, number: int, chance: random.Random) -> EpisodePlan:
        draw: DrawPlan = partial(draw_plan, f"g{self.games}", max_steps=chance.randint(200, 1500))
        plan = draw(self, chance)
        if number < REAL_TIME_ROOMS:
            plan.options |= {"clock": "realtime", "step_rate": 5.0, "thinking": "wall"}
            plan.people = [replace(person, view="state") for person in plan.people]
        return plan

    async def _until_over(self, plan: EpisodePlan) -> None:
        deadline = self.loop.time() + GAME_PATIENCE
        people = [p for p in self.participants if p.plan is plan]
        while not all(person.done for person in people) and not self.faults:
            if plan.over and all(person.process is None or person.done for person in people):
                return
            if self.loop.time() > deadline:
                self.fail(f"{plan.tag} has not ended after {GAME_PATIENCE} s; {self._where()}")
            await asyncio.sleep(1)

    def _forget(self, plan: EpisodePlan) -> None:
        """Check the recording, and discard all data of an ended episode."""
        for participant in [p for p in self.participants if p.plan is plan]:
            participant.gone()
            self.participants.remove(participant)
        self.plans.remove(plan)
        self.owners = {k: owner for k, owner in self.owners.items() if owner is not plan}
        for truth in [
            t for t in self.oracle.files.values() if t.over and (t.closed or t.discarded)
        ]:
            if truth.episode not in self.owners:
                truth.check_end()
                self.oracle.forget(truth)
                self.disk.files.pop(truth.name.removesuffix(".part"), None)

    async def _watch(self, end: float) -> None:
        """Compare the server with the recordings and measure its memory at regular intervals."""
        period = self.hours * HOUR / LOOKS
        while self.loop.time() < end and not self.faults:
            await asyncio.sleep(period)
            self.compare_server()
            self._tidy()
            blocks = sys.getallocatedblocks()
            self.blocks.append(blocks)
            self._report(
                f"{self.elapsed / HOUR:.2f} h: {self.games} games, "
                f"{self.oracle.counts['states']:,} states and {self.oracle.counts['heard']:,} "
                f"chat messages compared, {blocks:,} blocks allocated"
            )
        self._check_memory()

    def _check_memory(self) -> None:
        """Check that the minimum of the last quarter does not exceed that of the second quarter.

        By the second quarter, all tasks have been played and all code has run.
        """
        if self.hours < WARM_HOURS:
            return
        quarter = len(self.blocks) // 4
        early, late = self.blocks[quarter : 2 * quarter], self.blocks[-quarter:]
        if quarter and min(late) > GROWTH * min(early) + MARGIN:
            self.fail(f"memory grows: {self.blocks} allocated blocks in successive measurements")

    def _tidy(self) -> None:
        """Keep the simulation itself from growing.

        The caches of worlds and substitutes have bounds (tests/world/test_memory.py,
        tests/server/test_bots.py) that a day does not reach. Without the caches, any other growth
        is visible.
        """
        for memory in gc.get_objects():
            if type(memory) in (TimerTable, SuccessorTree, Goal, BotWorld):
                memory.forget()
        dead = [process for process in self.processes if process.dead]
        for process in dead:
            process.bury()
        self.processes = [process for process in self.processes if not process.dead]
        gc.collect()


def simulate_day(
    seed: int, hours: float, report: Callable[[str], None], *, rooms: int = 4
) -> Report:
    """Simulate `hours` of play; `report` receives a line per simulated hour."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        return Day(seed, hours, report, rooms).run()
    finally:
        if collecting:
            gc.enable()
