"""Planner bots beside people in real time: they think for so long only, ask for what is needed now,
and stand in nobody's way while they wait."""

from __future__ import annotations

import json
import random
from collections.abc import Callable

import pytest

from robotouille import GroundAction, State, World, load_task
from robotouille.episode import Clock
from robotouille.planning.anytime import EXPANSIONS_PER_STATE, AnytimePlanner
from robotouille.planning.beam.planner import UNSOLVED_FACTOR, BeamPlanner, Solution
from robotouille.planning.policies import PlannerPolicy
from robotouille.planning.policies.script import Did
from robotouille.planning.policies.standing import (
    is_out_of_the_way,
    standing_at,
    walk_to,
    walks_aside,
)
from robotouille.planning.policies.team_plan import Reliance, TeamPlanner
from robotouille.planning.policies.team_search import EXPANSIONS, MAX_BRIEF, TeamSearch
from robotouille.planning.policies.team_talk import INSIST
from robotouille.planning.search.unsolvable import CutOff
from robotouille.planning.search_result import Limits, Proof, SearchResult
from robotouille_client.bots.partner_worker import replies
from tests.support.samples import first_quickly
from tests.support.team_games import Chance, Idle, play_team

LAYER = 512
"""Expansions by which a search may go beyond its limit."""


class Work:
    """Counts what beam searches expand."""

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
    """Does what it likes for a while, deeds rather than walks, and then makes way."""

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


@pytest.mark.parametrize(
    ("task", "seed"),
    first_quickly([("01@2", 1), ("02@3", 2), ("07@4", 3), ("05@2", 4), ("08@3", 5)], nightly=3),
)
def test_whatever_a_person_does_a_decision_takes_bounded_work(
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
    assert max(spent) <= MAX_BRIEF + LAYER
    assert sum(each > 0 for each in spent) <= 2 + len(game.steps) // 5


def test_so_it_does_where_every_search_is_in_vain(
    work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A team that is cut off, and does not know it: it finds no plan whatever it counts on."""
    monkeypatch.setattr(CutOff, "__call__", lambda *_: False)
    world = World("multi_agent/07@4")
    anytime = AnytimePlanner(world)
    planner = TeamPlanner(anytime, TeamSearch(anytime, 0, EXPANSIONS), alone=False)
    team = world.players[1:]
    made = planner.make(world.initial, team, hurried=True)
    assert made.relies_on is not Reliance.TEAM
    assert 0 < work.expansions <= MAX_BRIEF + LAYER


def test_what_is_needed_is_asked_for_again_as_long_as_somebody_stands_there() -> None:
    """They stand at the only place of something, long after all that can be done is done."""
    world = World("multi_agent/01@3")
    bot = PlannerPolicy(world, "robot2", start=world.initial)
    bot.meet({"robot1": "human", "robot2": "bot", "robot3": "bot"}, "realtime")
    bot.act(world.initial)
    asked = []
    away = walks_aside(world.initial, "robot1")[0]
    for step in range(4 * INSIST):
        asked += [step for text in bot.speak() if text.startswith("I need")]
        bot.observe([("robot1", away, True)] if step == 2 * INSIST + 1 else [])
    assert asked == [0, INSIST, 2 * INSIST]


def test_greedy_search_after_them_takes_bounded_work_too(
    work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no plug-in knows the domain; a state takes longer than many expansions of the beam."""
    states: list[int] = []

    def in_vain(*_: object, limits: Limits, **__: object) -> SearchResult:
        states.append(limits.states or 0)
        return SearchResult(None, 0, Proof.NONE, "", 0)

    monkeypatch.setattr(CutOff, "__call__", lambda *_: False)
    monkeypatch.setattr("robotouille.planning.anytime.greedy_search", in_vain)
    world = World("workshop/02")
    anytime = AnytimePlanner(world)
    planner = TeamPlanner(anytime, TeamSearch(anytime, 0, EXPANSIONS), alone=False)
    planner.make(world.initial, world.players[:1], hurried=True)
    assert 0 < work.expansions <= MAX_BRIEF + LAYER
    assert 0 < sum(states) <= MAX_BRIEF // (UNSOLVED_FACTOR * EXPANSIONS_PER_STATE)


class Holder(Idle):
    """Takes something, and does with it what is asked of `then`."""

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


def test_while_a_person_merely_walks_no_plan_is_sought(work: Work) -> None:
    """They hold what is needed, and nothing comes of where they are."""
    wander = Chance("robot2")
    holder = Holder("lettuce1", wander.act)
    game = play_team("multi_agent/01@2", {"robot2": holder}, clock=Clock.REALTIME, limit=100)
    assert game.outcome is not None
    assert not game.outcome.success
    assert work.searches <= 6


def test_a_bot_that_waits_for_a_person_makes_way() -> None:
    """It has done its part; wherever the person wants to put what they hold, nobody stands."""
    aside: list[bool] = []

    def look(state: State) -> None:
        aside.append(is_out_of_the_way(state, "robot1") or bool(state.busy_steps("robot1")))

    holder = Holder("bottombun1", look)  # type: ignore[arg-type]
    play_team("multi_agent/01@2", {"robot2": holder}, clock=Clock.REALTIME, limit=60)
    assert len(aside) > 40
    assert all(aside[-20:])


def test_of_two_that_wait_for_each_others_place_one_gives_way() -> None:
    """The person has what the bot needs, and wants to get to where it was last at work."""

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


def test_what_a_bot_asks_is_of_the_state_in_which_it_is_said() -> None:
    """However much it has heard at once: it asks for what is in their hands, not any more once they
    have put it down, anywhere."""
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
        for _ in range(30):
            bot.observe([])
        walk = next(a for a in state.actions("robot2") if a.arguments[-1] == "table7")
        for action in (walk, world.action("place-item", "robot2", "bottombun1", "table7")):
            bot.observe([("robot2", action, True)] if puts else [])
        asked = [text for text in bot.speak() if text.startswith("Can you")]
        assert asked == ([] if puts else ["Can you put down the bottom bun?"])


def test_what_is_cut_off_is_told_again_and_again_as_it_is_told_once() -> None:
    world = World("multi_agent/07@3")
    again, chance, state = CutOff(world), random.Random(1), world.initial
    told = set()
    for _ in range(8):
        told.add(again(state, world.players[1:]))
        assert again(state, world.players[1:]) == CutOff(world)(state, world.players[1:])
        for _ in range(12):
            state = state.step([chance.choice(state.actions(world.players[0]))]).state
    assert told == {True, False}


def test_bots_say_nothing_before_they_have_heard_all() -> None:
    task, words = load_task("multi_agent/01"), "{}"
    kinds = {"robot1": "bot", "robot2": "human"}
    requests = [
        ("begin", json.dumps(task.to_json()), "planner", 0, ["robot1"], words),
        ("meet", kinds, "realtime"),
        ("observe", []),
    ]
    last = iter([False, True])
    said = list(replies(iter(requests), lambda: next(last)))
    assert [(what, player) for what, player, _ in said] == [("say", "robot1")]
