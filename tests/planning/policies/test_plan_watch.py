"""Checks of a plan of two cooks, and reordering of blocked plans."""

from __future__ import annotations

import pytest

from robotouille import GroundAction, State, World, load_task
from robotouille.episode import Clock
from robotouille.planning.plan import Limits, Plan
from robotouille.planning.policies.aside import with_others_aside
from robotouille.planning.policies.deferral import defer_blocked, who_can_begin
from robotouille.planning.policies.plan_watch import (
    DROP,
    KEEP,
    PATIENCE,
    SLOW,
    UNUSED,
    PastStep,
    PlanBase,
    PlanVerdict,
    PlanWatch,
    Teammates,
    facts_about,
    situation,
)
from robotouille.planning.policies.policy import Script
from robotouille.planning.policies.team_plan import (
    EXPANSIONS,
    WAYS,
    Assumption,
    Portion,
    TeamPlan,
    TeamPlanner,
    TeamSearch,
)
from robotouille.planning.solvers import AnytimePlanner
from tests.support.samples import quick_sample
from tests.support.team_games import Idle, play_team
from tests.world.kitchens import kitchen

RETRY = 2
LONG = 2 * PATIENCE
"""The steps for which a team of a kitchen of two waits."""

ONE = Teammates(("robot1",), ("robot2",))
BOTH = Teammates(("robot1", "robot2"), ())

KITCHEN = kitchen(
    items=[{"name": "lettuce", "x": 1, "y": 0}],
    goal=[{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}],
    players=[
        {"name": "robot", "x": 0, "y": 1, "direction": [0, -1]},
        {"name": "robot", "x": 3, "y": 1, "direction": [0, -1]},
    ],
)
TO_LETTUCE, TO_BOARD = "move robot1 table1 table2", "move robot1 table1 board1"
OTHER_TO_LETTUCE, OTHER_AWAY = "move robot2 stove1 table2", "move robot2 table2 stove2"
OTHER_ASIDE = "move robot2 stove1 stove2"
TAKES = "pick-up-item robot2 lettuce1 table2"


class Watched:
    """A watch and the state that it has processed."""

    def __init__(
        self,
        plan: list[str],
        teammates: Teammates,
        assumption: Assumption = Assumption.TEAM,
        *,
        before: str = "",
        in_vain: int = 0,
        opened: bool = False,
        instead_of: TeamPlan | None = None,
        **flags: bool,
    ) -> None:
        self.teammates, self.step = teammates, 0
        self.state = self._after(KITCHEN.initial, before)
        joint = Plan(tuple((_action(text),) for text in plan))
        made = TeamPlan(joint, self.state, assumption, instead_of=instead_of, **flags)
        self.watch = PlanWatch(
            made,
            Script("robot1", joint, KITCHEN.initial),
            PlanBase(0, self.state, facts_about(teammates.others, self.state)),
            retry=RETRY,
            in_vain={situation(self.state): in_vain},
            is_cut_off=lambda *_: not opened,
        )

    def _after(self, state: State, text: str) -> State:
        return state.step([_action(text)]).state if text else state

    def check(self, text: str = "") -> PlanVerdict:
        """Let a step pass with one action or none."""
        self.step, self.state = self.step + 1, self._after(self.state, text)
        did = [(text.split()[1], _action(text), True)] if text else []
        return self.watch.check(PastStep(self.step, self.state, did), self.teammates)


def _action(text: str) -> GroundAction:
    name, *arguments = text.split()
    return KITCHEN.action(name, *arguments)


def without(player: str) -> PlanVerdict:
    return PlanVerdict(keep=False, without=frozenset({player}))


NOTHING = [""]
HURRIED = BOTH._replace(hurried=True)
HURRIED_ONE = ONE._replace(hurried=True)
POSTPONED = 15
"""Steps between two looks at a goal that needs the help of others."""
TEAM_CASES = {
    "as planned": (TO_LETTUCE, ONE, [TO_LETTUCE], KEEP),
    "others walk elsewhere": (TO_LETTUCE, ONE, [OTHER_ASIDE], KEEP),
    "nothing for a while": (TO_LETTUCE, ONE, NOTHING * LONG, KEEP),
    "the seat takes its time": (TO_LETTUCE, ONE, NOTHING * (LONG + 1), KEEP),
    "in the way for a while": (TO_LETTUCE, ONE, [OTHER_TO_LETTUCE] + NOTHING * (LONG - 1), KEEP),
    "in the way for too long": (TO_LETTUCE, ONE, [OTHER_TO_LETTUCE] + NOTHING * LONG, DROP),
    "one does something else": (TO_LETTUCE, BOTH, [OTHER_TO_LETTUCE, TAKES], without("robot2")),
    "the seat does something else": (TO_LETTUCE, BOTH, [TO_BOARD], without("robot1")),
    "it makes way, and comes back": (TO_LETTUCE, ONE, [TO_BOARD], KEEP),
    "one is late": (OTHER_TO_LETTUCE, BOTH, NOTHING * (LONG + 1), without("robot2")),
    "it may be thinking": (OTHER_TO_LETTUCE, HURRIED, NOTHING * (SLOW * LONG), KEEP),
    "too long": (OTHER_TO_LETTUCE, HURRIED, NOTHING * (SLOW * LONG + 1), without("robot2")),
}


@pytest.mark.parametrize(
    ("plan", "teammates", "expected", "last"), TEAM_CASES.values(), ids=TEAM_CASES.keys()
)
def test_plan_that_relies_on_the_team(
    plan: str, teammates: Teammates, expected: list[str], last: PlanVerdict
) -> None:
    watched = Watched([plan], teammates)
    *before, verdict = [watched.check(text) for text in expected]
    assert set(before) <= {KEEP}
    assert verdict == last


def test_rest_of_a_plan_contains_no_pauses_and_reaches_the_goal() -> None:
    state = World("multi_agent/01@2").initial
    found = AnytimePlanner(state.world).first(state).plan
    assert found is not None
    slow = Plan(tuple(joint for each in found for joint in (each, (), ())))
    script = Script("robot1", slow, state)
    assert script.shortened(state.step([]).state) is not None
    first = next(iter(found))
    script.observe([(action.player or "", action, True) for action in first])
    start, state = state, state.step(list(first)).state
    rest = script.shortened(state)
    assert rest is not None
    assert len(rest) < len(slow) / 2
    for joint in rest:
        state = state.step(list(joint)).state
        script.observe([(action.player or "", action, True) for action in joint])
    assert state.goal_reached
    assert script.finished
    assert script.shortened(start) is None


@pytest.mark.parametrize(
    ("expected", "last"),
    [
        ([""] * 15, KEEP),
        ([""] * 16, DROP),
        (["", "", TAKES], DROP),
        ([TAKES], KEEP),
        ([OTHER_AWAY], PlanVerdict(way_is_free=True)),
    ],
    ids=[
        "they stand there",
        "they stand there for long",
        "they did something",
        "they did something just now",
        "they walk away",
    ],
)
def test_plan_that_relies_on_others_stepping_aside(expected: list[str], last: PlanVerdict) -> None:
    watched = Watched([TO_LETTUCE], ONE, Assumption.OTHERS_ASIDE, before=OTHER_TO_LETTUCE)
    *before, verdict = [watched.check(text) for text in expected]
    assert set(before) <= {KEEP}
    assert verdict == last
    assert (watched.watch.assumption is Assumption.TEAM) is last.way_is_free


@pytest.mark.parametrize(
    ("cut_off", "aside_untried", "opened", "walks", "last"),
    [
        (False, False, True, True, KEEP),
        (False, True, False, True, DROP),
        (False, True, False, False, KEEP),
        (True, False, True, True, DROP),
        (True, False, False, True, KEEP),
        (True, False, True, False, KEEP),
    ],
)
def test_plan_that_relies_on_everybody(
    cut_off: bool, aside_untried: bool, opened: bool, walks: bool, last: PlanVerdict
) -> None:
    flags = {"cut_off": cut_off, "aside_untried": aside_untried, "opened": opened}
    watched = Watched([TO_LETTUCE], ONE, Assumption.EVERYBODY, **flags)
    expected = [OTHER_ASIDE if walks else "", ""]
    assert [watched.check(text) for text in expected] == [KEEP, last]


@pytest.mark.parametrize("among_bots", [False, True])
@pytest.mark.parametrize("in_vain", [0, len(WAYS) + 1])
def test_waiting_bots_try_each_assumption(among_bots: bool, in_vain: int) -> None:
    teammates = ONE._replace(among_bots=among_bots)
    watched = Watched([TO_LETTUCE], teammates, Assumption.EVERYBODY, in_vain=in_vain)
    assert {watched.check() for _ in range(LONG)} == {KEEP}
    assert not watched.watch.is_stuck
    assert watched.check() == (DROP if among_bots and not in_vain else KEEP)
    assert watched.watch.is_stuck


def test_pauses_before_further_attempts_become_longer() -> None:
    teammates = ONE._replace(among_bots=True)
    watched = Watched([TO_LETTUCE], teammates, Assumption.EVERYBODY, in_vain=len(WAYS) + 1)
    assert {watched.check() for _ in range(2 * LONG)} == {KEEP}
    assert watched.check() == DROP


@pytest.mark.parametrize(
    ("prevented", "expected", "last"),
    [
        (Assumption.OTHERS_ASIDE, ["", ""], KEEP),
        (Assumption.OTHERS_ASIDE, [TAKES], KEEP),
        (Assumption.OTHERS_ASIDE, [OTHER_AWAY], DROP),
        (Assumption.EVERYBODY, [OTHER_AWAY], KEEP),
        (Assumption.EVERYBODY, [OTHER_AWAY] + NOTHING * POSTPONED, DROP),
        (Assumption.EVERYBODY, NOTHING * (POSTPONED + 1), KEEP),
    ],
)
def test_team_returns_to_its_first_goal_once_others_make_way(
    prevented: Assumption, expected: list[str], last: PlanVerdict
) -> None:
    steps = Plan(((_action(TO_LETTUCE),), (_action(TAKES.replace("robot2", "robot1")),)))
    first = TeamPlan(steps, KITCHEN.initial, prevented, can_begin=False)
    watched = Watched([TO_BOARD], HURRIED_ONE, before=OTHER_TO_LETTUCE, instead_of=first)
    *before, verdict = [watched.check(text) for text in expected]
    assert set(before) <= {KEEP}
    assert verdict == last


def test_goal_that_no_place_of_others_prevents_is_not_tried_in_each_step() -> None:
    first = TeamPlan(Plan(()), KITCHEN.initial, Assumption.OTHERS_ASIDE, can_begin=False)
    watched = Watched([TO_BOARD], HURRIED_ONE, instead_of=first)
    assert [watched.check(text) for text in ("", OTHER_ASIDE, "")] == [KEEP] * 3


def test_idle_steps_of_a_member_count_under_several_plans() -> None:
    state = World("multi_agent/01@3").initial
    team = ("robot1", "robot2")
    teammates = Teammates(team, ("robot3",), hurried=True)
    walk = next(each for each in state.actions("robot1") if each.destination)
    plan = Plan(((walk,),))

    def watch(idle: dict[str, int]) -> PlanWatch:
        return PlanWatch(
            TeamPlan(plan, state, Assumption.TEAM),
            Script("robot1", plan, state),
            PlanBase(0, state, 0, idle),
            retry=RETRY,
            in_vain={},
            is_cut_off=lambda *_: False,
        )

    first = watch({})
    for step in range(1, 11):
        assert not first.check(PastStep(step, state, []), teammates).unused
    assert first.idle == dict.fromkeys(team, 10)
    second = watch(dict.fromkeys(team, UNUSED - 1))
    assert second.check(PastStep(11, state, []), teammates).unused


@pytest.mark.parametrize(("other", "unused"), [(0, True), (UNUSED - 1, False)])
def test_team_that_waits_for_others_looks_again_for_work_of_a_member(
    other: int, unused: bool
) -> None:
    state = World("multi_agent/01@3").initial
    watch = PlanWatch(
        TeamPlan(Plan(()), state, Assumption.EVERYBODY),
        Script("robot1", Plan(()), state),
        PlanBase(0, state, 0, {"robot1": UNUSED - 1, "robot2": other}),
        retry=RETRY,
        in_vain={},
        is_cut_off=lambda *_: True,
    )
    teammates = Teammates(("robot1", "robot2"), ("robot3",), hurried=True)
    # If all members are idle, the team is stuck, for which it looks less often.
    assert watch.check(PastStep(1, state, []), teammates).unused == unused


def planned(task: str, person: str) -> tuple[Plan, State, State, list[str]]:
    """Return a plan for a person who has stepped aside, its state, and the present state."""
    world = World(task)
    team = [player for player in world.players if player != person]
    here = world.initial
    aside = with_others_aside(here, [person])
    found = next(
        AnytimePlanner(world).search(aside, Limits(expansions=1), team=team, beam=1_000, brief=True)
    )
    assert found.plan is not None
    return found.plan, aside, here, team


def after(plan: Plan, state: State) -> State:
    for joint in plan:
        state = state.step(list(joint)).state
    return state


def possible(plan: Plan, state: State) -> int:
    """Return the number of a player's actions before the first impossible one."""
    deeds = 0
    for joint in plan:
        for action in joint:
            if not state.world.applicable(state, action):
                return deeds
            deeds += action.destination is None
        state = state.step(list(joint)).state
    return deeds


@pytest.mark.parametrize(
    ("task", "person"),
    quick_sample([("02@2", "robot1"), ("04@2", "robot1"), ("10@2", "robot1")], 2),
)
def test_possible_work_comes_first(task: str, person: str) -> None:
    plan, aside, here, team = planned(f"multi_agent/{task}", person)
    other = defer_blocked(plan, aside, here, team)
    assert after(other, aside).goal_reached
    assert possible(other, here) > possible(plan, here)
    assert len(other) <= len(plan) + 6


def test_unblocked_plan_is_unchanged() -> None:
    plan, aside, _, team = planned("multi_agent/02@2", "robot1")
    assert defer_blocked(plan, aside, aside, team) is plan


def test_object_that_is_put_back_at_once_stays_where_it_is() -> None:
    plan, aside, _, team = planned("multi_agent/02@2", "robot1")
    bot = team[0]
    (stand,) = [a for a in aside.actions(bot) if a.destination == "table1"]
    there = aside.step([stand]).state
    (take,) = [a for a in there.actions(bot) if a.name == "pick-up-item"]
    (back,) = [a for a in there.step([take]).state.actions(bot) if a.name == "place-item"]
    useless = Plan(((stand,), (take,), (back,), *plan))
    assert after(useless, aside).goal_reached
    other = defer_blocked(useless, aside, aside, team)
    assert after(other, aside).goal_reached
    assert (back,) not in list(other)


@pytest.mark.parametrize(("task", "has_work"), [("07@4", True), ("02@4", False)])
def test_member_without_work_gets_some_or_the_plan_stays(task: str, has_work: bool) -> None:
    world = World(f"multi_agent/{task}")
    here, team = world.initial, ("robot2", "robot3", "robot4")
    anytime = AnytimePlanner(world)
    planner = TeamPlanner(anytime, TeamSearch(anytime, seed=0, expansions=EXPANSIONS), alone=False)
    plan = planner.decide(here, team, hurried=True).plan(Portion())
    assert plan.assumption is Assumption.OTHERS_ASIDE
    assert "robot3" not in who_can_begin(plan.plan, plan.base, here, team)
    other = planner.decide(here, team, hurried=True, rest=plan, unused={"robot3"}).plan(Portion())
    assert (other != plan) == has_work
    assert ("robot3" in who_can_begin(other.plan, other.base, here, team)) == has_work


@pytest.mark.slow
def test_bot_works_elsewhere_while_the_stove_is_blocked() -> None:
    game = play_team(
        load_task("multi_agent/02@2", timing="people"),
        {"robot1": Idle("robot1")},
        clock=Clock.REALTIME,
        limit=120,
    )
    done = [str(action) for did in game.steps for _, action, applied in did if applied]
    assert "stack(robot2, lettuce1, bottombun1, table3)" in done
    assert sum(each.startswith("cut(") for each in done) == 6
