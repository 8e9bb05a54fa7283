"""Games of planner bots next to simulated people: do the bots go on, and does help pay?

    python -m tests.programs.partner_games --skill partner --person helpful --person idle

Each game is played in real time at five steps a second, without planning time. A bot stands still
if no bot does anything for ten seconds, no effect runs, and the bots alone could still reach the
goal or come nearer to it.
"""

from __future__ import annotations

import argparse
import itertools
import random
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

from robotouille import GroundAction, State, World, load_task
from robotouille.episode import Clock
from robotouille.planning.plan import Plan
from robotouille.planning.policies import PlannerPolicy
from robotouille.planning.policies.aside import put_down, with_others_aside
from robotouille.planning.policies.deferral import can_begin
from robotouille.planning.policies.policy import Did, Policy
from robotouille.planning.policies.skill import SKILLS, Skill, SkilledPolicy
from robotouille.planning.policies.standing import (
    seat_out_of_the_way,
    standing_at,
    walks_out_of_the_way,
)
from robotouille.planning.solvers import AnytimePlanner
from tests.support.team_games import Idle, TeamGame, play_team

RATE = 5.0
"""Steps per second."""
STANDSTILL = int(10 * RATE)
LIMIT = 1_500
TASKS = [f"{number:02}" for number in range(1, 11)]


class Wanderer(Idle):
    """Walks to a random place every one to three seconds."""

    def __init__(self, player: str, seed: int) -> None:
        super().__init__(player)
        self._random, self._pause = random.Random(f"{seed}:{player}"), 0

    def act(self, state: State) -> GroundAction | None:
        self._pause -= 1
        walks = [a for a in state.actions(self.player) if a.destination]
        if self._pause > 0 or not walks:
            return None
        self._pause = self._random.randint(5, 15)
        return self._random.choice(walks)


class Hoarder(Wanderer):
    """Picks up the first thing it finds and carries it around; puts it down after a minute."""

    def __init__(self, player: str, seed: int) -> None:
        super().__init__(player, seed)
        self._step = 0

    def act(self, state: State) -> GroundAction | None:
        self._step += 1
        actions = state.actions(self.player)
        puts = [a for a in actions if a.name.startswith(("place", "stack"))]
        takes = [a for a in actions if a.name.startswith(("pick", "unstack"))]
        if puts and self._step > 60 * RATE:
            self._step = -10_000
            return puts[0]
        if takes and 0 <= self._step <= 60 * RATE:
            return takes[0]
        return super().act(state)


class Blocker(Idle):
    """Walks to the stove (or another place of work) and stays there for a minute."""

    def __init__(self, player: str, seed: int) -> None:
        super().__init__(player)
        self._step = 0

    def act(self, state: State) -> GroundAction | None:
        self._step += 1
        walks = [a for a in state.actions(self.player) if a.destination]
        here = standing_at(state, self.player) or ""
        if self._step > 60 * RATE:
            away = walks_out_of_the_way(state, self.player)
            return away[0] if away else None
        if here.startswith(("stove", "fryer")):
            return None
        wanted = [w for w in walks if str(w.destination).startswith(("stove", "fryer"))]
        return wanted[0] if wanted else None


class Newcomer:
    """Does the own part of a plan for everybody, with a newcomer's pauses.

    Someone who could do nothing for ten seconds makes way and thinks again.
    """

    kind = "human"

    def __init__(self, world: World, player: str, seed: int) -> None:
        self._world, self._player, self._seed = world, player, seed
        self._random = random.Random(f"{seed}:{player}")
        self._pause = self._idle = 0
        self._policy = self._new_policy()

    def _new_policy(self) -> SkilledPolicy:
        cook = PlannerPolicy(World(self._world.task), self._player)
        skill = Skill(reaction=0.4, pace=0.6, slips=0.03)
        return SkilledPolicy(cook, self._player, skill, step_seconds=1 / RATE, seed=self._seed)

    def observe(self, did: Did) -> None:
        self._policy.observe(did)
        self._idle += 1
        if any(player == self._player and ok for player, _, ok in did):
            self._idle = 0

    def act(self, state: State) -> GroundAction | None:
        self._pause -= 1
        if self._pause > 0:
            return None
        if self._random.random() < 0.05:
            self._pause = self._random.randint(5, 20)
            return None
        if self._idle > STANDSTILL:
            self._policy = self._new_policy()
            away = [*put_down(state, self._player), *walks_out_of_the_way(state, self._player)]
            return away[0] if away else None
        return self._policy.act(state)


def person(kind: str, world: World, player: str, seed: int) -> Policy:
    """Return a simulated person."""
    if kind == "helpful":
        return Newcomer(world, player, seed)
    if kind == "idle":
        return Idle(player)
    return {"wandering": Wanderer, "hoarding": Hoarder, "blocking": Blocker}[kind](player, seed)


PEOPLE = ("idle", "wandering", "hoarding", "blocking", "helpful")


@dataclass(frozen=True)
class Setting:
    """One game: a task, its seats, the person in the first seat (or nobody), skill and seed."""

    task: str
    seats: int
    person: str
    skill: str
    seed: int


@dataclass
class Report:
    """How a game went: steps, whether the goal was reached, and standstills of all bots."""

    setting: Setting
    steps: int
    won: bool
    could_win: bool = True
    stood: list[tuple[int, int, str]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)


def play(setting: Setting) -> Report:
    """Play one game."""
    task = load_task(f"multi_agent/{setting.task}@{setting.seats}", timing="people")
    world = World(task)
    people = {}
    if setting.person != "nobody":
        # The window gives a person this seat, too.
        seat = seat_out_of_the_way(world.initial)
        people[seat] = person(setting.person, world, seat, setting.seed)
    game = play_team(
        task, people, clock=Clock.REALTIME, limit=LIMIT, skill=SKILLS[setting.skill],
        step_rate=RATE, seed=setting.seed,
    )
    assert game.outcome is not None
    won = game.outcome.reason.value == "goal"
    report = Report(setting, len(game.steps), won)
    report.said = [f"{step} {player}: {text}" for step, player, text in game.said]
    bots = [p for p in world.players if p not in people]
    report.stood, last = standstills(world, game, bots)
    if not won:
        report.could_win = _plan_for(AnytimePlanner(World(task)), last, bots) == "goal"
    return report


def standstills(
    world: World, game: TeamGame, bots: Sequence[str]
) -> tuple[list[tuple[int, int, str]], State]:
    """Return first step, length and possible work of all standstills, and the last state."""
    anytime = AnytimePlanner(World(world.task))
    state, still, found = world.initial, 0, []
    for number, did in enumerate(game.steps):
        acted = any(p in bots and ok and (a.touched or a.effects) for p, a, ok in did)
        running = any(row.timed and row.running for row in state.progress())
        busy = any(state.busy_steps(p) for p in bots)
        still = 0 if acted or running or busy else still + 1
        if still == STANDSTILL:
            found.append((number - still, still, _plan_for(anytime, state, bots)))
        elif still > STANDSTILL:
            start, _, work = found[-1]
            found[-1] = start, still, work
        state = state.step([a for _, a, ok in did if ok]).state
    return found, state


def _plan_for(anytime: AnytimePlanner, state: State, bots: Sequence[str]) -> str:
    """Return what the bots could do alone: reach the goal, some of the work, or nothing."""
    state, team = anytime.in_model(state), tuple(sorted(bots))
    if _plan(anytime, state, team) is not None:
        return "goal"
    aside = with_others_aside(state, [p for p in state.world.players if p not in bots])
    plan = _plan(anytime, aside, team)
    return "work" if plan is not None and can_begin(plan, aside, state, team) else ""


def _plan(anytime: AnytimePlanner, state: State, team: tuple[str, ...]) -> Plan | None:
    *_, found = anytime.search(state, team=team, beam=8_000, choices=6)
    return found.plan


def settings(options: argparse.Namespace) -> Iterator[Setting]:
    """Yield all games to play."""
    for task, seats, who, seed in itertools.product(
        options.task or TASKS,
        options.seats or (2, 3, 4),
        options.person or ("nobody", *PEOPLE),
        range(options.seeds),
    ):
        yield Setting(task, seats, who, options.skill, seed)


def main() -> int:
    """Play games and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", action="append")
    parser.add_argument("--seats", action="append", type=int)
    parser.add_argument("--person", action="append", choices=["nobody", *PEOPLE])
    parser.add_argument("--skill", default="partner", choices=list(SKILLS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--talk", action="store_true", help="print the chat")
    options = parser.parse_args()
    faults = 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for report in pool.map(play, settings(options)):
            where = report.setting
            bad = [each for each in report.stood if each[2]]
            faults += bool(bad) or (not report.won and report.could_win)
            print(
                f"{where.task}@{where.seats} {where.person:10} {where.seed} "
                f"{report.steps:5} {'won' if report.won else 'LOST' if report.could_win else 'lost'}"
                + "".join(f"  still {a}+{n} {work or '-'}" for a, n, work in report.stood),
                flush=True,
            )
            if options.talk:
                print("\n".join(report.said))
    print(f"{faults} faults")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
