"""Planner bots next to people in real time: bounded work, requests, and making way."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from itertools import pairwise

import pytest

from robotouille import GroundAction, State, World, load_task
from robotouille.episode import Clock
from robotouille.planning.beam.planner import UNSOLVED_FACTOR, BeamPlanner, Solution
from robotouille.planning.beam.remaining_work_heuristic import GoalPart
from robotouille.planning.plan import Plan
from robotouille.planning.policies import PlannerPolicy
from robotouille.planning.policies.making_way import MakingWay
from robotouille.planning.policies.policy import Did
from robotouille.planning.policies.skill import SKILLS
from robotouille.planning.policies.standing import (
    is_out_of_the_way,
    seat_out_of_the_way,
    standing_at,
    walk_to,
    walks_out_of_the_way,
)
from robotouille.planning.policies.team_plan import BRIEF, MAX_BRIEF, PART, PORTION
from robotouille.planning.policies.team_talk import INSIST
from tests.programs.simulated_people import RATE, person
from tests.support.samples import quick_sample
from tests.support.team_games import Idle, RandomWalker, play_team
from tests.world.kitchens import kitchen

LAYER = 512
"""Expansions by which a search may go beyond its limit."""


class Work:
    """Counter of the expansions of beam searches."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.expansions = self.searches = 0
        solve = BeamPlanner.solve

        def counted(planner: BeamPlanner, *args: object, **options: object) -> Solution:
            found: Solution = solve(planner, *args, **options)  # type: ignore[arg-type]
            self.expansions += found.expansions
            self.searches += 1
            return found

        monkeypatch.setattr(BeamPlanner, "solve", counted)


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Work:
    return Work(monkeypatch)


class Odd(Idle):
    """Policy that acts at random for a while, then makes way."""

    def __init__(self, player: str, seed: int, deeds: int) -> None:
        super().__init__(player)
        self._random, self._deeds = random.Random(f"{seed}:{player}"), deeds

    def act(self, state: State) -> GroundAction | None:
        self._deeds -= 1
        if self._deeds % 3:
            return None
        walks = [a for a in state.actions(self.player) if a.destination]
        deeds = [a for a in state.actions(self.player) if a not in walks]
        if self._deeds < 0:
            deeds = [a for a in deeds if a.name.startswith("place")]
            return deeds[0] if deeds else None
        some = deeds if deeds and self._random.random() < 0.6 else walks
        return self._random.choice(some) if some else None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "seed"),
    quick_sample([("01@2", 1), ("02@3", 2), ("07@4", 3), ("05@2", 4), ("08@3", 5)], nightly=3),
)
def test_decision_work_is_bounded_next_to_a_person(
    work: Work, monkeypatch: pytest.MonkeyPatch, task: str, seed: int
) -> None:
    spent: list[int] = []
    act = PlannerPolicy.act

    def measured(policy: PlannerPolicy, state: State) -> GroundAction | None:
        before = work.expansions
        action = act(policy, state)
        spent.append(work.expansions - before)
        return action

    monkeypatch.setattr(PlannerPolicy, "act", measured)
    task = f"multi_agent/{task}"
    game = play_team(
        load_task(task, timing="people"),
        {"robot1": Odd("robot1", seed, 60)},
        clock=Clock.REALTIME,
        limit=120,
    )
    # A bot acts between two searches, so a step contains one search without a plan at most.
    assert max(spent) <= PORTION + UNSOLVED_FACTOR * BRIEF + LAYER
    assert sum(spent) <= (MAX_BRIEF + LAYER) * (2 + len(game.steps) // 5)


@pytest.mark.slow
def test_analysis_for_other_objects_is_spread_over_several_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    parts: list[GoalPart] = []
    spent: list[int] = []
    act, begin = PlannerPolicy.act, GoalPart.__post_init__

    def counted(part: GoalPart) -> None:
        parts.append(part)
        begin(part)

    def measured(policy: PlannerPolicy, state: State) -> GroundAction | None:
        before = len(parts)
        action = act(policy, state)
        spent.append(len(parts) - before)
        return action

    monkeypatch.setattr(GoalPart, "__post_init__", counted)
    monkeypatch.setattr(PlannerPolicy, "act", measured)
    world = World(load_task("multi_agent/10@3", timing="people"))
    hoarder = person("hoarding", world, "robot1", 0)
    play_team(world.task, {"robot1": hoarder}, clock=Clock.REALTIME, limit=60)
    # Before the first step, both bots analyse the kitchen at once.
    assert sum(spent[2:]) > 3 * PORTION // PART
    assert max(spent[2:]) <= 1.5 * PORTION // PART


NO_PLAN = Solution(Plan(()), reached=False, remaining_work=9.0, expansions=PORTION)


class Bench:
    """A bot next to a person in real time, whose searches can be made to fail."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch
        self.world = World(load_task("multi_agent/01@2", timing="people"))
        self.bot = PlannerPolicy(self.world, "robot1", start=self.world.initial)
        self.bot.meet({"robot1": "bot", "robot2": "human"}, "realtime")
        self.state = self.world.initial

    def fail(self) -> None:
        """Let all further searches fail."""
        self._monkeypatch.setattr(BeamPlanner, "solve", lambda *_, **__: NO_PLAN)

    def decide(self) -> GroundAction | None:
        """Let the bot decide as soon as it can."""
        while self.state.busy_steps("robot1"):
            self.step()
        return self.bot.act(self.state)

    def work(self) -> None:
        """Let the bot make its first plan, and do the first thing other than a walk."""
        action = None
        while action is None or action.destination is not None:
            action = self.decide()
            self.step(*(() if action is None else (action,)))

    def step(self, *actions: GroundAction) -> None:
        """Take a step of the game."""
        step = self.state.step(list(actions))
        self.bot.observe([(a.action.player or "", a.action, a.applied) for a in step.attempts])
        self.state = step.state


@pytest.mark.slow
def test_bot_that_plans_goes_on_with_its_last_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, other = Bench(monkeypatch), Bench(monkeypatch)
    for each in (bench, other):
        each.work()
    due = other.decide()
    assert due is not None
    bench.fail()
    # A bot joins the team and leaves it, so a new plan is needed.
    bench.bot.meet({"robot1": "bot", "robot2": "bot"}, "realtime")
    bench.bot.meet({"robot1": "bot", "robot2": "human"}, "realtime")
    assert str(bench.decide()) == str(due)


def test_bot_that_plans_makes_way(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch)
    bench.fail()
    assert bench.decide() is None
    bench.step()
    action = bench.decide()
    assert action is not None
    assert action in walks_out_of_the_way(bench.state, "robot1")


def test_bot_that_makes_way_stays_near() -> None:
    state = World(load_task("shifts/01@2", timing="people")).initial
    near, far = sorted(walks_out_of_the_way(state, "robot2"), key=lambda walk: walk.duration)
    assert near.duration < far.duration
    chosen = [MakingWay("robot2", random.Random(seed)).step_aside(state) for seed in range(5)]
    assert chosen == [near] * 5


@pytest.mark.slow
def test_bot_at_a_blocked_hatch_does_not_take_the_same_object_again_and_again() -> None:
    task = load_task("shifts/01@2", timing="people")
    world = World(task)
    seat = seat_out_of_the_way(world.initial)
    blocker = person("at_hatch", world, seat, 0)
    game = play_team(
        task,
        {seat: blocker},
        clock=Clock.REALTIME,
        limit=260,
        skill=SKILLS["partner"],
        step_rate=RATE,
    )
    taken = Counter(
        str(action)
        for did in game.steps
        for player, action, applied in did
        if player != seat and applied and action.name == "pick-up-item"
    )
    # The bot lays the object down to do other work, but nothing else is possible.
    assert max(taken.values()) == 1


SLOW_MACHINE = 800.0
"""Expansions per step of a busy computer, a fifth of those of an idle one."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "who"),
    quick_sample(
        [("shifts/01@2", "at_hatch"), ("shifts/01@2", "keeping"), ("multi_agent/07@3", "hoarding")],
        nightly=3,
    ),
)
def test_bot_on_a_slow_machine_never_thinks_for_long(task: str, who: str) -> None:
    started = load_task(task, timing="people")
    seat = seat_out_of_the_way(World(started).initial)
    game = play_team(
        started,
        {seat: person(who, World(started), seat, 0)},
        clock=Clock.REALTIME,
        limit=200,
        skill=SKILLS["partner"],
        step_rate=RATE,
        speed=SLOW_MACHINE,
    )
    assert max((thought.steps for thought in game.thoughts), default=0) <= RATE


def test_work_begins_though_a_person_stands_where_the_next_object_lies() -> None:
    world = kitchen(
        items=[
            {"name": "patty", "x": 3, "y": 0, "predicates": ["iscookable"]},
            {"name": "tomato", "x": 1, "y": 0, "predicates": ["iscuttable"]},
        ],
        goal=[
            {"predicate": "iscooked", "args": ["patty"], "ids": [1]},
            {"predicate": "iscut", "args": ["tomato"], "ids": [2]},
        ],
        players=[
            {"name": "robot", "x": 1, "y": 1, "direction": [0, -1]},
            {"name": "robot", "x": 3, "y": 1, "direction": [0, -1]},
        ],
    )
    game = play_team(world.task, {"robot1": Idle("robot1")}, clock=Clock.REALTIME, limit=10)
    assert "cook" in [action.name for did in game.steps for _, action, applied in did if applied]


@pytest.mark.slow
def test_request_is_repeated_after_longer_and_longer_pauses() -> None:
    # The person stands at the only stove.
    task = load_task("multi_agent/02@2", timing="people")
    game = play_team(task, {"robot1": Idle("robot1")}, clock=Clock.REALTIME, limit=6 * INSIST)
    asked = [step for step, _, text in game.said if text == "I need the stove, please"]
    pauses = [later - earlier for earlier, later in pairwise(asked)]
    assert len(asked) >= 3
    assert all(pause >= INSIST << times for times, pause in enumerate(pauses))


@pytest.mark.slow
@pytest.mark.parametrize("task", ["multi_agent/03@3", "multi_agent/05@3", "multi_agent/07@3"])
def test_bots_go_on_beside_someone_who_does_nothing(task: str) -> None:
    started = load_task(task, timing="people")
    alone = play_team(started, clock=Clock.REALTIME, limit=600)
    person = seat_out_of_the_way(World(started).initial)
    beside = play_team(started, {person: Idle(person)}, clock=Clock.REALTIME, limit=600)
    assert alone.outcome is not None and beside.outcome is not None
    assert beside.outcome.success
    assert beside.outcome.steps <= 2 * alone.outcome.steps


class Holder(Idle):
    """Policy that takes an object and then calls `then`."""

    def __init__(self, item: str, then: Callable[[State], GroundAction | None]) -> None:
        super().__init__("robot2")
        self._item, self._then = item, then

    def act(self, state: State) -> GroundAction | None:
        if state.holds("has_item", self.player, self._item):
            return self._then(state)
        if not state.holds("nothing", self.player):
            return None
        take = [a for a in state.actions(self.player) if self._item in a.arguments]
        if take:
            return take[0]
        at = next((a[2] for a in state.atoms() if a[:2] == ("item_at", self._item)), None)
        return walk_to(state, self.player, at)


@pytest.mark.slow
def test_mere_walks_cause_no_search(work: Work) -> None:
    wander = RandomWalker("robot2")
    holder = Holder("lettuce1", wander.act)
    game = play_team("multi_agent/01@2", {"robot2": holder}, clock=Clock.REALTIME, limit=100)
    assert game.outcome is not None
    assert not game.outcome.success
    # Every five seconds the bot looks for another way; walks alone cause no search.
    assert work.searches <= 20


def test_waiting_bot_makes_way() -> None:
    aside: list[bool] = []

    def look(state: State) -> None:
        aside.append(is_out_of_the_way(state, "robot1") or bool(state.busy_steps("robot1")))

    holder = Holder("bottombun1", look)
    play_team("multi_agent/01@2", {"robot2": holder}, clock=Clock.REALTIME, limit=60)
    assert len(aside) > 40
    assert all(aside[-20:])


@pytest.mark.slow
def test_mutual_waiting_is_resolved() -> None:
    class Rival(Holder):
        place, waited, arrived = "", 0, False

        def observe(self, did: Did) -> None:
            for player, action, applied in did:
                if player == "robot1" and applied and action.destination is None:
                    self.waited, self.place = 0, action.arguments[-1]
            self.waited += 1

    def go(state: State) -> GroundAction | None:
        rival.arrived = rival.arrived or standing_at(state, "robot2") == rival.place
        waits = rival.waited > 10 and not rival.arrived
        return walk_to(state, "robot2", rival.place) if waits else None

    rival = Rival("bottombun1", go)
    play_team("multi_agent/01@2", {"robot2": rival}, clock=Clock.REALTIME, limit=60)
    assert rival.arrived


@pytest.mark.slow
def test_requests_fit_the_current_state() -> None:
    for puts in (False, True):
        world = World("multi_agent/01@2")
        bot = PlannerPolicy(world, "robot1", start=world.initial)
        bot.meet({"robot1": "bot", "robot2": "human"}, "realtime")
        holder, state = Holder("bottombun1", lambda _: None), world.initial
        for _ in range(18):
            actions = [a for a in (bot.act(state), holder.act(state)) if a is not None]
            step = state.step(actions)
            bot.observe([(a.action.player or "", a.action, a.applied) for a in step.attempts])
            state = step.state
        bot.speak()
        for _ in range(12):
            bot.observe([])
        walk = next(a for a in state.actions("robot2") if a.arguments[-1] == "table7")
        for action in (walk, world.action("place-item", "robot2", "bottombun1", "table7")):
            bot.observe([("robot2", action, True)] if puts else [])
        asked = [said.text for said in bot.speak() if said.text.startswith("Can you")]
        assert asked == ([] if puts else ["Can you put down the bottom bun?"])


@pytest.mark.slow
def test_bot_asks_nobody_for_what_it_could_do_itself() -> None:
    task = load_task("multi_agent/02@2", timing="people")
    # The person stands at the only stove. The patty lies where the bot could take it.
    game = play_team(
        task,
        {"robot1": person("idle", World(task), "robot1", 0)},
        clock=Clock.REALTIME,
        limit=300,
        skill=SKILLS["partner"],
        step_rate=RATE,
    )
    said = [text for _, _, text in game.said if not text.startswith("Next:")]
    assert "I need the stove, please" in said
    assert "Can you pick up the patty?" not in said
