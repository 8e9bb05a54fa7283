"""Games of planner bots next to simulated people: do the bots go on, and does help pay?

    python -m tests.programs.partner_games --skill partner --person helpful --person idle

Each game is played in real time at five steps a second. Planning takes no time without `--speed`.
The bots stand still if none of them does anything for ten seconds, no effect runs, and they alone
could still reach the goal or come nearer to it. Next to a person who does nothing, a game is slow
if it takes more than twice as long as a careful plan for the bots alone, carried out with the same
skill. `idle` is the longest time of each bot without an action, in steps with an open order.
"""

from __future__ import annotations

import argparse
import itertools
import math
import random
import sys
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple

from robotouille import GroundAction, State, World, load_task, task_names
from robotouille.domain.rendering import language_of
from robotouille.domain.task import Task
from robotouille.episode import Clock
from robotouille.planning.plan import Plan
from robotouille.planning.policies.agenda import Agenda, OneGoal, OpenOrders
from robotouille.planning.policies.aside import after, holds, put_down, with_others_aside
from robotouille.planning.policies.deferral import after_possible
from robotouille.planning.policies.policy import Did, Policy, Script, Speech, does_something
from robotouille.planning.policies.skill import SKILLS, Skill, SkilledPolicy
from robotouille.planning.policies.standing import (
    seat_out_of_the_way,
    standing_at,
    walks_out_of_the_way,
)
from robotouille.planning.policies.team_plan import BRIEF, HURRIED
from robotouille.planning.policies.team_talk import requested
from robotouille.planning.shift import DishPlanner
from robotouille.planning.solvers import AnytimePlanner
from robotouille.world.presentation.wording import Wording
from tests.support.team_games import Idle, TeamGame, play_team

RATE = 5.0
"""Steps per second."""
STANDSTILL = int(10 * RATE)
LIMIT, SHIFT = 1_500, 10_000
OBVIOUS = 6
"""Steps of a plan that people see at once."""
SLOW = 2
"""Ratio to the length of a planned game from which a game is slow."""
TASKS = [n for n in task_names() if n.startswith(("multi_agent/", "shifts/"))]


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


class Keeper(Hoarder):
    """Picks up the first thing it finds, and carries it around to the end."""

    def act(self, state: State) -> GroundAction | None:
        self._step = 0
        return super().act(state)


class Blocker(Idle):
    """Walks to a place of work and stays there, for some steps or to the end."""

    def __init__(self, player: str, kinds: tuple[str, ...], steps: int = sys.maxsize) -> None:
        super().__init__(player)
        self._kinds, self._steps = kinds, steps

    def act(self, state: State) -> GroundAction | None:
        self._steps -= 1
        if self._steps < 0:
            away = walks_out_of_the_way(state, self.player)
            return away[0] if away else None
        if (standing_at(state, self.player) or "").startswith(self._kinds):
            return None
        walks = [a for a in state.actions(self.player) if a.destination]
        wanted = [w for w in walks if str(w.destination).startswith(self._kinds)]
        return wanted[0] if wanted else None


class Cook:
    """Does one piece of work after the other, as someone would who sees only the kitchen.

    The piece is the own part of a plan for everybody. After three seconds without a chance to go
    on, it is a piece that is possible while the others stand still, or a step out of the way.
    """

    def __init__(self, world: World, player: str) -> None:
        self._player = player
        if world.shift is None:
            self._agenda: Agenda = OneGoal(AnytimePlanner(World(world.task)))
        else:
            self._agenda = OpenOrders(world, {})
        self._topic: Hashable = None
        self._script: Script | None = None
        self._hands_full = False
        self._idle = self._planned = 0

    def observe(self, did: Did) -> None:
        self._idle += 1
        if self._script is not None:
            self._script.observe(did, [player for player, _, _ in did])
        if any(p == self._player and ok and does_something(action) for p, action, ok in did):
            self._idle = self._planned = 0

    def act(self, state: State) -> GroundAction | None:
        full = holds(state, self._player)
        done = self._hands_full and not full
        self._hands_full = full
        if self._agenda.topic(state) != self._topic:
            self._topic, self._script = self._agenda.topic(state), None
            self._idle = self._planned = 0
        if self._idle > STANDSTILL:
            self._script = None
            away = [*put_down(state, self._player), *walks_out_of_the_way(state, self._player)]
            return away[0] if away else None
        stuck = self._idle - self._planned > 3 * RATE
        script = self._script
        if script is None or script.finished or script.astray or done or stuck:
            script = self._script = self._plan(state, alone=stuck)
            self._planned = self._idle
        return script.act(state)

    def is_at_work(self, state: State) -> bool:
        """Return whether the next action is possible where the cook stands."""
        action = None if self._script is None else self._script.act(state)
        return action is not None and action.destination is None

    def _plan(self, state: State, *, alone: bool) -> Script:
        for anytime in self._agenda.goals(state)[:1]:
            here = anytime.in_model(state)
            aside = with_others_aside(here, [p for p in here.world.players if p != self._player])
            plan, start = self._search(anytime, aside, (self._player,)), aside
            # Everybody sees that a dish is nearly ready.
            if not alone and len(plan) not in range(1, OBVIOUS + 1):
                plan, start = self._search(anytime, here, tuple(here.world.players)), here
            return Script(self._player, plan, start, direct=True)
        return Script(self._player, Plan(()), state)

    def _search(self, anytime: AnytimePlanner, start: State, team: tuple[str, ...]) -> Plan:
        search = anytime.search(start, HURRIED, team=team, beam=BRIEF, choices=6)
        return next(search).plan or Plan(())


class Newcomer:
    """Cooks with a newcomer's pauses, and makes way two seconds after a request."""

    kind = "human"
    anticipating = False

    def __init__(self, world: World, player: str, seed: int) -> None:
        skill = Skill(reaction=0.4, pace=0.6, slips=0.03)
        self._player = player
        self._cook = Cook(world, player)
        self._policy = SkilledPolicy(self._cook, player, skill, step_seconds=1 / RATE, seed=seed)
        self._random = random.Random(f"{seed}:{player}")
        self._wording = Wording(world, language_of(world.task))
        self._state = world.initial
        self._pause = 0
        self._asked = -1

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        pass

    def speak(self) -> list[Speech]:
        return []

    def hear(self, player: str, speech: Speech) -> None:
        text = speech.text
        here = standing_at(self._state, self._player)
        if here is not None and requested(text, here, self._state, self._wording):
            self._asked = int(2 * RATE)

    def observe(self, did: Did) -> None:
        self._policy.observe(did)

    def act(self, state: State) -> GroundAction | None:
        self._state = state
        self._asked -= 1
        if self._asked == 0 and not self._cook.is_at_work(state):
            away = walks_out_of_the_way(state, self._player)
            return away[0] if away else None
        self._pause -= 1
        if self._pause > 0:
            return None
        if self._random.random() < 0.05:
            self._pause = self._random.randint(5, 20)
            return None
        return self._policy.act(state)


STOVES, COUNTERS = ("stove", "fryer"), ("hatch",)


def person(kind: str, world: World, player: str, seed: int) -> Policy:
    """Return a simulated person."""
    made: dict[str, Callable[[], Policy]] = {
        "idle": lambda: Idle(player),
        "wandering": lambda: Wanderer(player, seed),
        "hoarding": lambda: Hoarder(player, seed),
        "keeping": lambda: Keeper(player, seed),
        "blocking": lambda: Blocker(player, STOVES, int(60 * RATE)),
        "at_stove": lambda: Blocker(player, STOVES),
        "at_hatch": lambda: Blocker(player, COUNTERS),
        "helpful": lambda: Newcomer(world, player, seed),
    }
    return made[kind]()


PEOPLE = (
    "idle", "wandering", "hoarding", "keeping", "blocking", "at_stove", "at_hatch", "helpful",
)  # fmt: skip


@dataclass(frozen=True)
class Setting:
    """One game: a task, its seats, the person in the first seat (or nobody), skill and seed."""

    task: str
    seats: int
    person: str
    skill: str
    seed: int
    speed: float = math.inf


class Standstill(NamedTuple):
    """Steps in which no bot did anything: the first one, their number, and the possible work."""

    start: int
    steps: int
    work: str


@dataclass
class Report:
    """Result of a game.

    `planned` is the number of steps in which the bots can reach the goal next to a person who does
    nothing; 0 if that is unknown or impossible.
    """

    setting: Setting
    steps: int
    won: bool
    could_win: bool = True
    planned: int = 0
    points: int | None = None
    stood: list[Standstill] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    thoughts: list[int] = field(default_factory=list)
    idle: list[int] = field(default_factory=list)

    @property
    def fault(self) -> str:
        """The faults of the game, or nothing."""
        slow = 0 < self.planned * SLOW < self.steps
        still = any(each.work for each in self.stood)
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
            + (f"  thought {sum(self.thoughts)} max {max(self.thoughts)}" if self.thoughts else "")
            + f"  idle {self.idle}"
            + "".join(f"  still {a}+{n} {work or '-'}" for a, n, work in self.stood)
        )


def play(setting: Setting) -> Report:
    """Play one game."""
    task = load_task(setting.task, seats=setting.seats, timing="people")
    world = World(task)
    people = {}
    if setting.person != "nobody":
        # The window gives a person this seat, too.
        seat = seat_out_of_the_way(world.initial)
        people[seat] = person(setting.person, world, seat, setting.seed)
    bots = [p for p in world.players if p not in people]
    game = _game(task, people, setting)
    assert game.outcome is not None
    shift = world.shift is not None
    won = shift or game.outcome.reason.value == "goal"
    report = Report(setting, len(game.steps), won)
    report.said = [f"{step} {player}: {text}" for step, player, text in game.said]
    kitchen = Kitchen(world, bots)
    report.stood, last = standstills(kitchen, game)
    report.thoughts = [thought.steps for thought in game.thoughts]
    report.idle = idle_steps(world, bots, game)
    if game.outcome.score is not None:
        report.points = game.outcome.score.points
    elif setting.person == "idle":
        report.planned = planned_length(task, people, setting, bots)
        report.could_win = report.planned > 0
    elif not won:
        report.could_win = kitchen.possible(last) == "goal"
    return report


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


def planned_length(
    task: Task, people: Mapping[str, Policy], setting: Setting, bots: Sequence[str]
) -> int:
    """Return the steps of a game in which all bots follow one careful plan; 0 without a plan."""
    anytime = AnytimePlanner(World(task))
    start = anytime.in_model(World(task).initial)
    plan = _plan(anytime, start, tuple(sorted(bots)))
    if plan is None:
        return 0
    skill, seed = SKILLS[setting.skill], setting.seed
    scripts = {
        p: SkilledPolicy(Script(p, plan, start), p, skill, step_seconds=1 / RATE, seed=seed)
        for p in bots
    }
    return len(_game(task, {**people, **scripts}, setting).steps)


class Kitchen:
    """The work that the bots of a game can do alone, for the goal or for an open order."""

    def __init__(self, world: World, bots: Sequence[str]) -> None:
        self.world = world
        self.bots = tuple(sorted(bots))
        self._dishes: dict[str, DishPlanner] = {}
        if world.shift is None:
            self._anytime = AnytimePlanner(World(world.task))
        else:
            self._dishes = {name: DishPlanner(world, name) for name in world.shift.menu}

    def possible(self, state: State) -> str:
        """Return what the bots could do alone: reach the goal, some of the work, or nothing."""
        found = {_work(anytime, here, self.bots) for anytime, here in self._tasks(state)}
        return next((work for work in ("goal", "work") if work in found), "")

    def _tasks(self, state: State) -> Iterator[tuple[AnytimePlanner, State]]:
        if self.world.shift is None or state.orders is None:
            yield self._anytime, state
            return
        for name in sorted({self.world.shift.dish_name(each.number) for each in state.orders.open}):
            yield self._dishes[name].anytime, state


def standstills(kitchen: Kitchen, game: TeamGame) -> tuple[list[Standstill], State]:
    """Return all standstills, and the last state."""
    state, still = kitchen.world.initial, 0
    found: list[Standstill] = []
    for number, did in enumerate(game.steps):
        acted = any(p in kitchen.bots and ok and does_something(a) for p, a, ok in did)
        running = any(row.timed and row.running for row in state.progress())
        busy = any(state.busy_steps(p) for p in kitchen.bots)
        unordered = state.orders is not None and not state.orders.open
        still = 0 if acted or running or busy or unordered else still + 1
        if still == STANDSTILL:
            found.append(Standstill(number - still, still, kitchen.possible(state)))
        elif still > STANDSTILL:
            found[-1] = found[-1]._replace(steps=still)
        state = state.step([a for _, a, ok in did if ok]).state
    return found, state


def idle_steps(world: World, bots: Sequence[str], game: TeamGame) -> list[int]:
    """Return for each bot the longest time in steps without an action while an order is open."""
    state = world.initial
    longest, idle = dict.fromkeys(bots, 0), dict.fromkeys(bots, 0)
    for did in game.steps:
        acted = {player for player, action, applied in did if applied and does_something(action)}
        unordered = state.orders is not None and not state.orders.open
        for bot in bots:
            idle[bot] = 0 if bot in acted or unordered or state.busy_steps(bot) else idle[bot] + 1
            longest[bot] = max(longest[bot], idle[bot])
        state = state.step([a for _, a, applied in did if applied]).state
    return list(longest.values())


def _work(anytime: AnytimePlanner, state: State, bots: tuple[str, ...]) -> str:
    state = anytime.in_model(state)
    if _plan(anytime, state, bots) is not None:
        return "goal"
    others = [p for p in state.world.players if p not in bots]
    # An object in hand may keep a bot from all other work. To put it down is no progress yet.
    fewest = sys.maxsize
    for bot in (*bots, ""):
        here = _relieved(state, bot)
        if here is None:
            continue
        aside = with_others_aside(here, others)
        plan = _leanest(anytime, aside, bots)
        if plan is None:
            continue
        needed = _deeds(plan) if bot else min(_deeds(plan), fewest - 1)
        fewest = min(fewest, needed)
        later = with_others_aside(after_possible(plan, aside, here, bots), others)
        rest = _leanest(anytime, later, bots)
        if rest is not None and _deeds(rest) < needed:
            return "work"
    return ""


def _leanest(anytime: AnytimePlanner, state: State, bots: tuple[str, ...]) -> Plan | None:
    """Return the plan with the fewest actions other than walks of a few plans."""
    plans = [next(anytime.search(state, team=bots, seed=seed)).plan for seed in range(4)]
    return min((plan for plan in plans if plan is not None), key=_deeds, default=None)


def _deeds(plan: Plan) -> int:
    """Return the number of actions other than walks."""
    return sum(action.destination is None for joint in plan for action in joint)


def _relieved(state: State, player: str) -> State | None:
    """Return a state after a player has put down everything, or None if that is impossible."""
    actions = put_down(state, player) if player else ()
    for action in actions:
        state = after(state, action)
    return state if actions or not player else None


def _plan(anytime: AnytimePlanner, state: State, team: tuple[str, ...]) -> Plan | None:
    *_, found = anytime.search(state, team=team, beam=8_000, choices=6)
    return found.plan


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
        hatch = who != "at_hatch" or task.startswith("shifts/")
        if seats in (load_task(task).problem.seats or ()) and not alone and hatch:
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
