"""Games of planner bots next to simulated people: do the bots go on, and does help pay?

    python -m tests.programs.partner_games --skill partner --person helpful --person idle

Each game is played in real time at five steps a second. Planning takes no time without `--speed`.

* A bot stands still if it does nothing for ten seconds although it has useful work in all of them:
  see `bot_work`. The work of other bots does not excuse it. But work is only useful if it would
  have shortened the game, so a game about as short as a planned game has no such fault.
* A game is slow if it takes more than twice as long as a planned game. There, all bots carry out
  one careful plan with the same skill, next to a person who steps out of the way at once and then
  does nothing. So all people in one seat have the same measure. Steps in which people make the goal
  impossible for the bots, such as while they stand at the only stove, do not count.
* A game is lost if the bots alone could reach the goal: from its first state if the person does
  nothing, else from its last one.

`idle` is the longest time of each bot without an action, in steps with an open order.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache, lru_cache

from robotouille import State, load_task, task_names
from robotouille.domain.task import Task
from robotouille.episode import Clock
from robotouille.planning.policies.aside import with_others_aside
from robotouille.planning.policies.policy import Policy, Script
from robotouille.planning.policies.skill import SKILLS, SkilledPolicy
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille.planning.policies.team_plan import NEAR
from tests.programs.bot_work import Kitchen, Standstill, idle_steps, standstills, states
from tests.programs.simulated_people import IN_SHIFTS, PEOPLE, RATE, Blocker, person
from tests.support.team_games import TeamGame, play_team

LIMIT, SHIFT = 1_500, 10_000
SLOW = 2
"""Ratio to the length of a planned game from which a game is slow."""
TASKS = [n for n in task_names() if n.startswith(("multi_agent/", "shifts/"))]


@dataclass(frozen=True)
class Setting:
    """One game: a task, its seats, the person in the first seat (or nobody), skill and seed."""

    task: str
    seats: int
    person: str
    skill: str
    seed: int
    speed: float = math.inf


@dataclass
class Report:
    """Result of a game.

    `planned` is the number of steps of a planned game; 0 without a plan. `blocked` is the
    number of steps in which people made the goal impossible; it is only counted in long games.
    `seconds` is the processor time of the game, without that of its measures.
    """

    setting: Setting
    steps: int
    won: bool
    could_win: bool = True
    planned: int = 0
    blocked: int = 0
    seconds: float = 0.0
    points: int | None = None
    stood: list[Standstill] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    thoughts: list[int] = field(default_factory=list)
    idle: list[int] = field(default_factory=list)

    @property
    def fault(self) -> str:
        """The faults of the game, or nothing."""
        slow = 0 < self.planned * SLOW < self.steps - self.blocked
        short = self.won and self.steps <= NEAR * self.planned
        still = any(each.work for each in self.stood) and not short
        lost = not self.won and self.could_win
        return " ".join(["LOST"] * lost + ["SLOW"] * slow + ["STILL"] * still)

    def __str__(self) -> str:
        """Return a line about the game."""
        where = self.setting
        result = "won" if self.won else "lost"
        if self.points is not None:
            result = f"{self.points} points"
        return (
            f"{where.task}@{where.seats} {where.person:10} {where.seed} {self.steps:5} "
            f"{result:10} {self.fault}"
            + (f"  planned {self.planned}" if self.planned else "")
            + (f"  blocked {self.blocked}" if self.blocked else "")
            + (f"  thought {sum(self.thoughts)} max {max(self.thoughts)}" if self.thoughts else "")
            + f"  idle {self.idle}  {self.seconds:.1f} s"
            + "".join(f"  {bot} still {a}+{n} {work or '-'}" for bot, a, n, work in self.stood)
        )


def play(setting: Setting) -> Report:
    """Play one game."""
    kitchen = _kitchen(setting.task, setting.seats)
    world = kitchen.world
    people: dict[str, Policy] = {}
    if setting.person != "nobody":
        # The window gives a person this seat, too.
        seat = seat_out_of_the_way(world.initial)
        people[seat] = person(setting.person, world, seat, setting.seed)
    bots = tuple(sorted(p for p in world.players if p not in people))
    began = time.process_time()
    game = _game(kitchen.task, people, setting)
    seconds = time.process_time() - began
    assert game.outcome is not None
    shift = world.shift is not None
    won = shift or game.outcome.reason.value == "goal"
    report = Report(setting, len(game.steps), won, seconds=seconds)
    report.said = [f"{step} {player}: {text}" for step, player, text in game.said]
    report.stood = standstills(kitchen, bots, game)
    report.thoughts = [thought.steps for thought in game.thoughts]
    report.idle = idle_steps(world, bots, game)
    if game.outcome.score is not None:
        report.points = game.outcome.score.points
        return report
    reached = states(world, game)
    report.planned = planned_length(setting.task, setting.seats, bots, setting.skill, setting.seed)
    if report.planned * SLOW < report.steps:
        report.blocked = _blocked_steps(kitchen, bots, reached)
    if not won:
        decisive = reached[0 if setting.person == "idle" else -1]
        report.could_win = kitchen.plan(decisive, bots) is not None
    return report


@lru_cache(maxsize=2)
def _kitchen(task: str, seats: int) -> Kitchen:
    return Kitchen(load_task(task, seats=seats, timing="people"))


def _blocked_steps(kitchen: Kitchen, bots: tuple[str, ...], reached: Sequence[State]) -> int:
    """Return the number of steps in which people make the goal impossible for the bots."""
    blocked, known = 0, dict[int, bool]()
    for state in reached[:-1]:
        if state.facts not in known:
            known[state.facts] = kitchen.is_cut_off(state, bots)
        blocked += known[state.facts]
    return blocked


def _game(task: Task, others: Mapping[str, Policy], setting: Setting) -> TeamGame:
    return play_team(
        task,
        others,
        clock=Clock.REALTIME,
        limit=LIMIT if task.problem.shift is None else SHIFT,
        skill=SKILLS[setting.skill],
        step_rate=RATE,
        seed=setting.seed,
        speed=setting.speed,
    )


@cache
def planned_length(task: str, seats: int, bots: tuple[str, ...], skill_name: str, seed: int) -> int:
    """Return the number of steps of a planned game; 0 without a plan."""
    kitchen = _kitchen(task, seats)
    world, skill = kitchen.world, SKILLS[skill_name]
    others = [p for p in world.players if p not in bots]
    planned = kitchen.plan(with_others_aside(world.initial, others), bots)
    if planned is None:
        return 0
    plan, start = planned
    policies: dict[str, Policy] = {p: Blocker(p, (), steps=0) for p in others}
    for bot in bots:
        script = Script(bot, plan, start)
        policies[bot] = SkilledPolicy(script, bot, skill, step_seconds=1 / RATE, seed=seed)
    setting = Setting(task, seats, "", skill_name, seed)
    return len(_game(kitchen.task, policies, setting).steps)


def settings(options: argparse.Namespace) -> Iterator[Setting]:
    """Yield all games to play."""
    tasks = [f"multi_agent/{name}" if "/" not in name else name for name in options.task or TASKS]
    for task, seats, who, seed in itertools.product(
        tasks,
        options.seats or (1, 2, 3, 4),
        options.person or ("nobody", *PEOPLE),
        range(options.seeds),
    ):
        alone = seats == 1 and who != "nobody"
        possible = who not in IN_SHIFTS or task.startswith("shifts/")
        if seats in (load_task(task).problem.seats or ()) and not alone and possible:
            yield Setting(task, seats, who, options.skill, seed, options.speed)


def main() -> int:
    """Play games and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", action="append", metavar="NAME")
    parser.add_argument("--seats", action="append", type=int)
    parser.add_argument("--person", action="append", choices=["nobody", *PEOPLE])
    parser.add_argument("--skill", default="partner", choices=list(SKILLS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument(
        "--speed",
        type=float,
        default=math.inf,
        metavar="N",
        help="expansions per step of the processor of all bots; a slow machine has about 800",
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--talk", action="store_true", help="print the chat")
    options = parser.parse_args()
    faults = 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for report in pool.map(play, settings(options)):
            faults += bool(report.fault)
            print(report, flush=True)
            if options.talk:
                print("\n".join(report.said))
    print(f"{faults} faults")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
