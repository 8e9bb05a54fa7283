"""When a plan is dropped, and whom it counts on no more: a few steps of two cooks at a time."""

from __future__ import annotations

import pytest

from robotouille import GroundAction, State
from robotouille.planning.plan import Plan
from robotouille.planning.policies.past_step import PastStep
from robotouille.planning.policies.plan_watch import (
    DROP,
    KEEP,
    PATIENCE,
    SLOW,
    Company,
    PlanBase,
    PlanWatch,
    Verdict,
    facts_about,
)
from robotouille.planning.policies.script import Script
from robotouille.planning.policies.team_plan import WAYS, Reliance, TeamPlan
from tests.world.kitchens import kitchen

RETRY = 2
LONG = 2 * PATIENCE
"""The steps for which a team of a kitchen of two waits."""

ONE = Company(("robot1",), ("robot2",))
BOTH = Company(("robot1", "robot2"), ())

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
    """A watch, and the state that it has been told."""

    def __init__(
        self,
        plan: list[str],
        company: Company,
        relies_on: Reliance = Reliance.TEAM,
        *,
        before: str = "",
        in_vain: int = 0,
        cut_off: bool = False,
        aside_untried: bool = False,
        opened: bool = False,
    ) -> None:
        self.company, self.step = company, 0
        self.state = self._after(KITCHEN.initial, before)
        joint = Plan(tuple((_action(text),) for text in plan))
        made = TeamPlan(joint, self.state, relies_on, cut_off=cut_off, aside_untried=aside_untried)
        self.watch = PlanWatch(
            made,
            Script("robot1", joint, KITCHEN.initial),
            PlanBase(0, self.state, facts_about(company.others, self.state)),
            retry=RETRY,
            in_vain={self.state: in_vain},
            is_cut_off=lambda *_: not opened,
        )

    def _after(self, state: State, text: str) -> State:
        return state.step([_action(text)]).state if text else state

    def heed(self, text: str = "") -> Verdict:
        """Let a step pass in which one thing is done, or nothing."""
        self.step, self.state = self.step + 1, self._after(self.state, text)
        did = [(text.split()[1], _action(text), True)] if text else []
        return self.watch.heed(PastStep(self.step, self.state, did), self.company)


def _action(text: str) -> GroundAction:
    name, *arguments = text.split()
    return KITCHEN.action(name, *arguments)


@pytest.mark.parametrize(
    ("plan", "company", "told", "last"),
    [
        pytest.param([TO_LETTUCE], ONE, [TO_LETTUCE], KEEP, id="as planned"),
        pytest.param([TO_LETTUCE], ONE, [OTHER_ASIDE], KEEP, id="others walk elsewhere"),
        pytest.param([TO_LETTUCE], ONE, [""] * LONG, KEEP, id="nothing for a while"),
        pytest.param([TO_LETTUCE], ONE, [""] * (LONG + 1), DROP, id="nothing for too long"),
        pytest.param(
            [TO_LETTUCE],
            ONE,
            [OTHER_TO_LETTUCE] + [""] * (LONG - 1),
            KEEP,
            id="somebody in the way for a while",
        ),
        pytest.param(
            [TO_LETTUCE],
            ONE,
            [OTHER_TO_LETTUCE] + [""] * LONG,
            DROP,
            id="somebody in the way for too long",
        ),
        pytest.param(
            [TO_LETTUCE],
            BOTH,
            [OTHER_TO_LETTUCE, TAKES],
            Verdict(keeps=False, without=frozenset({"robot2"})),
            id="one of the team does something else",
        ),
        pytest.param(
            [TO_LETTUCE],
            BOTH,
            [TO_BOARD],
            Verdict(keeps=False, without=frozenset({"robot1"})),
            id="the seat itself does something else",
        ),
        pytest.param([TO_LETTUCE], ONE, [TO_BOARD], KEEP, id="it makes way, and comes back"),
        pytest.param(
            [OTHER_TO_LETTUCE],
            BOTH,
            [""] * (LONG + 1),
            Verdict(keeps=False, without=frozenset({"robot2"})),
            id="one of the team is late",
        ),
        pytest.param(
            [OTHER_TO_LETTUCE],
            BOTH._replace(hurried=True),
            [""] * (SLOW * LONG),
            KEEP,
            id="it may be thinking",
        ),
        pytest.param(
            [OTHER_TO_LETTUCE],
            BOTH._replace(hurried=True),
            [""] * (SLOW * LONG + 1),
            Verdict(keeps=False, without=frozenset({"robot2"})),
            id="it has thought for too long",
        ),
    ],
)
def test_a_plan_of_the_teams_own(
    plan: list[str], company: Company, told: list[str], last: Verdict
) -> None:
    watched = Watched(plan, company)
    *before, verdict = [watched.heed(text) for text in told]
    assert set(before) <= {KEEP}
    assert verdict == last


@pytest.mark.parametrize(
    ("told", "last"),
    [
        ([""] * 20, KEEP),
        (["", "", TAKES], DROP),
        ([TAKES], KEEP),
        ([OTHER_AWAY], Verdict(way_is_free=True)),
    ],
    ids=["they stand there", "they did something", "they did something just now", "they walk away"],
)
def test_a_plan_for_when_others_have_walked(told: list[str], last: Verdict) -> None:
    watched = Watched([TO_LETTUCE], ONE, Reliance.OTHERS_ASIDE, before=OTHER_TO_LETTUCE)
    *before, verdict = [watched.heed(text) for text in told]
    assert set(before) <= {KEEP}
    assert verdict == last
    assert (watched.watch.relies_on is Reliance.TEAM) is last.way_is_free


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
def test_a_plan_for_when_others_do_their_part(
    cut_off: bool, aside_untried: bool, opened: bool, walks: bool, last: Verdict
) -> None:
    """Where they walk matters if it may open a way."""
    watched = Watched(
        [TO_LETTUCE],
        ONE,
        Reliance.EVERYBODY,
        cut_off=cut_off,
        aside_untried=aside_untried,
        opened=opened,
    )
    told = [OTHER_ASIDE if walks else "", ""]
    assert [watched.heed(text) for text in told] == [KEEP, last]


@pytest.mark.parametrize("among_bots", [False, True])
@pytest.mark.parametrize("in_vain", [0, len(WAYS)])
def test_bots_that_wait_for_each_other_try_every_way_once(among_bots: bool, in_vain: int) -> None:
    company = ONE._replace(among_bots=among_bots)
    watched = Watched([TO_LETTUCE], company, Reliance.EVERYBODY, in_vain=in_vain)
    assert {watched.heed() for _ in range(LONG)} == {KEEP}
    assert not watched.watch.is_stuck
    assert watched.heed() == (DROP if among_bots and not in_vain else KEEP)
    assert watched.watch.is_stuck
