"""Teams of planner bots: one plan, requests, and making way."""

from __future__ import annotations

from math import floor
from typing import Any

import pytest

from robotouille import GroundAction, State, World, load_certificate, load_task
from robotouille.domain.rendering import language_of
from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.planning.policies import (
    PlannerOptions,
    PlannerPolicy,
    Policy,
    RandomPolicy,
    TeamPolicy,
)
from robotouille.planning.policies.policy import Speech
from robotouille.planning.policies.standing import standing_at, walks_aside
from robotouille.planning.policies.team_talk import (
    VERSION,
    announced_version,
    announcement,
    appeal,
    appealed,
    no_plan_text,
    request,
    requested,
)
from robotouille.planning.search.unsolvable import ReachabilityCheck
from robotouille.world.presentation.signals import signal_text
from robotouille.world.presentation.wording import Wording
from tests.support.samples import quick_sample
from tests.support.team_games import Idle, RandomWalker, TeamGame, play_team

QUICK = 500
"""Expansions that are enough where lengths do not matter."""

NEAR = [f"multi_agent/{number:02d}" for number in (1, 4, 3, 2, 5, 8, 9)]


def steps(game: TeamGame) -> int:
    """Return the steps to the goal and check that nothing was requested in vain."""
    assert game.outcome is not None
    assert game.outcome.success, game.said
    assert [tally.rejected for tally in game.outcome.seats] == [0] * len(game.outcome.seats)
    return game.outcome.steps


@pytest.mark.slow
@pytest.mark.parametrize("name", quick_sample(NEAR, 3, nightly=5))
def test_two_bots_need_the_certified_steps(name: str) -> None:
    certified = load_certificate(load_task(name)).length or 0
    assert steps(play_team(name)) <= floor(1.05 * certified)


@pytest.mark.slow
@pytest.mark.parametrize("clock", quick_sample([Clock.TURN, Clock.REALTIME]))
def test_no_needless_requests_under_other_clocks(clock: Clock) -> None:
    assert steps(play_team("multi_agent/01", clock=clock, expansions=QUICK)) <= 32


@pytest.mark.parametrize(
    ("name", "idle"),
    quick_sample([("04@3", "robot2"), ("04@3", "robot3"), ("01@2", "robot2"), ("05@2", "robot1")]),
)
def test_bots_go_around_a_person_who_stands_still(name: str, idle: str) -> None:
    game = play_team(f"multi_agent/{name}", {idle: Idle(idle)}, expansions=QUICK)
    assert steps(game) <= 40


def test_blocked_goal_is_proven() -> None:
    start = World("multi_agent/01@3").initial
    assert ReachabilityCheck(start.world)(start, ("robot2", "robot3"))
    assert not ReachabilityCheck(start.world)(start, start.world.players)
    game = play_team("multi_agent/01@3", {"robot1": Idle("robot1")}, expansions=QUICK, limit=45)
    asked = [
        step
        for step, _, text in game.said
        if text == "I need the table with the bottom bun, please"
    ]
    assert asked == [0], "once"


@pytest.mark.slow
def test_bots_ask_for_a_blocked_place_and_use_it() -> None:
    task = "multi_agent/07@4"
    start = World(load_task(task)).initial
    at_sink = next(p for p in start.world.players if "sink" in (standing_at(start, p) or ""))
    person = Asked(at_sink)
    game = play_team(task, {at_sink: person}, expansions=QUICK, limit=80)
    assert person.asked == "I need the sink, please"
    assert sum(text == person.asked for _, _, text in game.said) == 1
    assert steps(game) < 80


class Helper(Idle):
    """Policy that takes some actions, each a number of steps after the last."""

    def __init__(self, player: str, course: str, every: int) -> None:
        super().__init__(player)
        self._course, self._every, self._step = course.split("; "), every, 0

    def act(self, state: State) -> GroundAction | None:
        self._step += 1
        if not self._course or self._step % self._every:
            return None
        name, *arguments = self._course[0].split()
        action = state.world.action(name, self.player, *arguments)
        if not state.world.applicable(state, action):
            return None
        del self._course[0]
        return action


HELP = (
    "move table1 table6; pick-up-item lettuce1 table6; move table6 board1; "
    "place-item lettuce1 board1; cut lettuce1 board1; cut lettuce1 board1; cut lettuce1 board1; "
    "pick-up-item lettuce1 board1; move board1 table5; place-item lettuce1 table5; "
    "move table5 table7"
)


@pytest.mark.slow
def test_bot_does_the_rest_while_a_person_helps() -> None:
    helper = Helper("robot2", HELP, 6)
    task = load_task("multi_agent/01@2", timing="people")
    game = play_team(task, {"robot2": helper}, clock=Clock.REALTIME, expansions=QUICK)
    assert game.outcome is not None
    assert game.outcome.success, game.said
    meanwhile = {str(a) for did in game.steps[:60] for p, a, ok in did if ok and p == "robot1"}
    assert any(action.startswith("cook(robot1, patty1") for action in meanwhile)
    assert any(action.startswith("stack(robot1, patty1, bottombun1") for action in meanwhile)
    assert not [text for _, _, text in game.said if text == no_plan_text()]
    last = max(step for step, did in enumerate(game.steps) if any(p == "robot2" for p, _, _ in did))
    assert game.outcome.steps <= last + 25


@pytest.mark.slow
def test_holder_of_a_needed_object_is_asked_to_act() -> None:
    holder = Helper("robot2", "move table1 table6; pick-up-item lettuce1 table6", 1)
    game = play_team("multi_agent/01@2", {"robot2": holder}, expansions=QUICK, limit=60)
    received = [text for _, _, text in game.said if text.startswith("Can you ")]
    assert len(received) == 1, game.said
    assert "lettuce" in received[0]
    assert "cook(robot1, patty1, stove1)" in {str(a) for did in game.steps for _, a, _ in did}


class Asked(Idle):
    """Policy that walks aside on request."""

    anticipating = False
    asked = ""

    def meet(self, kinds: Any, clock: str) -> None:
        pass

    def hear(self, player: str, speech: Speech) -> None:
        if speech.text.startswith("I need"):
            self.asked = speech.text

    def speak(self) -> list[Speech]:
        return []

    def act(self, state: Any) -> Any:
        return next(iter(walks_aside(state, self.player)), None) if self.asked else None


@pytest.mark.parametrize(
    ("seed", "travel"), quick_sample([(5, True), (5, False), (6, True), (7, False)])
)
def test_wandering_person_does_not_stop_the_bots(seed: int, travel: bool) -> None:
    person = RandomWalker("robot2", seed, travel=travel)
    game = play_team("multi_agent/01@3", {"robot2": person}, expansions=QUICK)
    assert game.outcome is not None
    assert game.outcome.success
    assert [tally.invalid for tally in game.outcome.seats] == [0, 0, 0]


@pytest.mark.slow
def test_bot_announces_its_destination() -> None:
    game = play_team("multi_agent/01", {"robot2": Idle("robot2")}, expansions=QUICK)
    received = [text for _, player, text in game.said if player == "robot1"]
    # Only other bots need to know its version.
    assert announcement() not in received
    assert received[0].startswith("Next: go to ")
    assert len(received) <= 2 + game.outcome.steps // 6 if game.outcome else False


@pytest.mark.slow
def test_team_does_without_an_absent_bot() -> None:
    world = World(load_task("multi_agent/01"))

    def alter(step: int, policies: dict[str, Policy]) -> None:
        gone = 4 <= step < 9
        if step == 4:
            policies["robot2"] = Idle("robot2")
        if step == 9:
            policies["robot2"] = PlannerPolicy(world, "robot2", PlannerOptions(expansions=QUICK))
        for policy in policies.values():
            if isinstance(policy, TeamPolicy):
                kinds = {"robot1": "bot", "robot2": "absent" if gone else "bot"}
                policy.meet(kinds, Clock.LOCKSTEP)

    game = play_team(world.task, alter=alter, expansions=QUICK)
    assert steps(game) <= 30
    done = [player for did in game.steps[9:] for player, *_ in did]
    assert done.count("robot2") > 2


@pytest.mark.slow
def test_other_kinds_and_versions_are_not_counted_on() -> None:
    for other in (RandomPolicy("robot2"), Stranger("robot2", seed=3, travel=False)):
        game = play_team("multi_agent/01", {"robot2": other}, expansions=QUICK)
        assert game.outcome is not None
        assert game.outcome.success
        assert game.outcome.seats[0].rejected == 0


class Stranger(RandomWalker):
    """Planner bot of another version."""

    kind = "bot"
    anticipating = False

    def __init__(self, player: str, seed: int, *, travel: bool) -> None:
        super().__init__(player, seed, travel=travel)
        self._said = [Speech(f"planner {VERSION + 1}", to_bots=True)]

    def meet(self, kinds: Any, clock: str) -> None:
        pass

    def hear(self, player: str, speech: Speech) -> None:
        pass

    def speak(self) -> list[Speech]:
        said, self._said = self._said, []
        return said


def test_bot_makes_way_on_request_and_returns() -> None:
    world = World(load_task("multi_agent/01"))
    bot = PlannerPolicy(world, "robot1", PlannerOptions(expansions=QUICK), start=world.initial)
    bot.meet({"robot1": "bot", "robot2": "human"}, Clock.LOCKSTEP)
    station, state = "", world.initial
    for _ in range(20):
        station = standing_at(state, "robot1") or ""
        if station and world.thing(station).kind != "table":
            break
        state = _next(bot, state)
    bot.hear("robot2", Speech(f"please, I need the {world.thing(station).kind}"))
    state = _next(bot, state)
    assert standing_at(state, "robot1") != station
    for _ in range(60):
        state = _next(bot, state)
    assert state.goal_reached


def _next(bot: PlannerPolicy, state: Any) -> Any:
    action = bot.act(state)
    step = state.step([action])
    bot.observe([("robot1", a.action, a.applied) for a in step.attempts])
    return step.state


def test_requests_are_understood() -> None:
    world = World(load_task("multi_agent/01"))
    words, start = Wording(world, language_of(world.task)), world.initial
    sink = next(o.name for o in world.initial.objects if o.type == "station")
    assert announced_version(announcement().text) == VERSION
    assert announced_version("I am planner 1") is None
    for station in world.floor.stations:
        sent = request(station).signal
        assert sent is not None
        asked = signal_text(sent, start, words)
        reported = [each for each in world.floor.stations if requested(asked, each, start, words)]
        assert reported == [station]
    assert requested(f"I need {sink}: please make way, robot1", sink, start, words)
    assert requested(f"I NEED the {world.thing(sink).kind}!", sink, start, words)
    assert not requested(f"I am at {sink}", sink, start, words)
    assert not requested("I need a break", sink, start, words)
    assert requested("table 2, please", "table2", start, words)
    assert not requested("table 2, please", "table3", start, words)


def test_appeal_names_its_addressee() -> None:
    world = World(load_task("multi_agent/01"))
    words, start = Wording(world, language_of(world.task)), world.initial
    deed = next(a for a in start.actions("robot2") if a.destination)
    assert appealed(appeal(deed, start, words), "robot1", start, words) == "robot2"
    assert appealed("I need the stove, please", "robot1", start, words) is None
    assert appealed("Can you?  Or not", "robot1", start, words) is None
    crowd = World(load_task("multi_agent/01", seats=3))
    words, state = Wording(crowd, language_of(crowd.task)), crowd.initial
    assert appealed("Can you go away?", "robot1", state, words) is None
    for line in ("move", "pick-up-item"):
        action = next(a for a in state.actions("robot3") if a.name == line
                      and (line != "move" or any(b[0] == "item_on" and b[2] == a.destination
                                                 for b in state.atoms())))  # fmt: skip
        state = state.step(action).state
    held = next(b[2] for b in state.atoms() if b[0] == "has_item")
    asked = f"Can you put down the {words.kind(crowd.thing(held).kind)}?"
    assert appealed(asked, "robot1", state, words) == "robot3"


def test_action_may_anticipate_another_in_the_same_step() -> None:
    world = World(load_task("multi_agent/01"))
    here = {p: standing_at(world.initial, p) or "" for p in world.players}
    free = next(a for a in world.initial.actions("robot2") if a.destination).arguments[2]
    leave = world.action("move", "robot2", here["robot2"], free)
    follow = world.action("move", "robot1", here["robot1"], here["robot2"])
    for both in (True, False):
        episode = Episode(world, Rules(clock=Clock.LOCKSTEP))
        for player in world.players:
            episode.join(player, player, "bot", 0.0)
        episode.submit("robot1", ActionRequest(1, follow, anticipates=True), 0.1)
        episode.submit("robot2", ActionRequest(1, leave if both else None), 0.2)
        assert episode.step == 1
        assert episode.state.holds("loc", "robot1", here["robot2" if both else "robot1"])
        assert episode.seats["robot1"].tally.rejected == int(not both)
