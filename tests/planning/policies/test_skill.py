"""Skills of bots: slower games, equal seeds, and help that pays."""

from __future__ import annotations

import pytest

from robotouille import GroundAction, State, World, load_task
from robotouille.episode import Clock
from robotouille.errors import RobotouilleError
from robotouille.planning.policies.policy import Did
from robotouille.planning.policies.skill import (
    EXPERT,
    SKILLS,
    Skill,
    SkilledPolicy,
    skill_named,
)
from tests.programs.partner_games import Setting, play
from tests.support.samples import quick_sample
from tests.support.team_games import TeamGame, play_team


def cooked(skill: Skill, clock: Clock = Clock.REALTIME, seed: int = 0) -> TeamGame:
    task = load_task("multi_agent/01@2", timing="people")
    return play_team(task, clock=clock, limit=900, skill=skill, step_rate=5, seed=seed)


def steps(game: TeamGame) -> int:
    assert game.outcome is not None and game.outcome.success
    return game.outcome.steps


@pytest.mark.slow
def test_skills_differ_in_real_time_only() -> None:
    learner, partner, expert = (steps(cooked(SKILLS[name])) for name in SKILLS)
    assert learner > partner > expert
    patient = Skill(reaction=1.0, pace=1.0, rest=0.5)
    assert steps(cooked(patient, Clock.LOCKSTEP)) == steps(cooked(EXPERT, Clock.LOCKSTEP))


def test_equal_seeds_give_equal_games() -> None:
    clumsy = Skill(pace=0.4, slips=0.3)
    first, again, other = (cooked(clumsy, seed=seed) for seed in (1, 1, 2))
    assert str(first.steps) == str(again.steps)
    assert str(first.steps) != str(other.steps)


def test_someone_who_does_not_look_ahead_waits_for_the_stove() -> None:
    game = cooked(Skill(looks_ahead=False))
    cooking = next(
        (number, player)
        for number, did in enumerate(game.steps)
        for player, action, applied in did
        if applied and action.name == "cook"
    )
    begun, cook = cooking
    acted = [
        number
        for number, did in enumerate(game.steps)
        for player, action, applied in did
        if number > begun and player == cook and applied and action.touched
    ]
    # Cooking takes three steps, and five times as many at the pace of people.
    assert acted[0] - begun >= 15


@pytest.mark.parametrize(
    ("clock", "kind", "partner"),
    [("realtime", "human", True), ("realtime", "bot", False), ("lockstep", "human", False)],
)
def test_the_default_skill_fits_the_company(clock: str, kind: str, partner: bool) -> None:
    world = World("multi_agent/01@2")
    bot = SkilledPolicy(Thinker("robot1"), "robot1", None, step_seconds=0.2)
    bot.meet({"robot1": "bot", "robot2": kind}, clock)
    action = bot.act(world.initial)
    assert action is not None
    bot.observe([("robot1", action, True)])
    state = world.initial.step([action]).state
    assert (bot.act(state) is None) == partner, "a partner takes its time"


class Thinker:
    """Policy that walks somewhere in each step, and counts its thoughts in pauses."""

    def __init__(self, player: str) -> None:
        self._player = player
        self.thoughts = 0

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        return next(a for a in state.actions(self._player) if a.destination)

    def think(self, state: State) -> None:
        self.thoughts += 1


def test_bot_thinks_in_its_pauses() -> None:
    state = World(load_task("multi_agent/01@2")).initial
    thinker = Thinker("robot1")
    policy = SkilledPolicy(thinker, "robot1", Skill(pace=1.0), step_seconds=0.2)
    walk = policy.act(state)
    assert walk is not None
    policy.observe([("robot1", walk, True)])
    pause = 0
    while policy.act(state) is None:
        pause += 1
        policy.observe([])
    assert thinker.thoughts == pause > 0


class Taker(Thinker):
    """Policy that takes the object at its place."""

    def act(self, state: State) -> GroundAction | None:
        return next((a for a in state.actions(self._player) if not a.destination), None)


def pause_after_work(did: Did) -> int:
    """Return the steps that one of three bots rests after its work, when others did something."""
    state = World(load_task("multi_agent/10@4")).initial
    bot = SkilledPolicy(Taker("robot4"), "robot4", Skill(pace=1.0, rest=0.3), step_seconds=0.2)
    bot.meet({p: "human" if p == "robot1" else "bot" for p in state.world.players}, "realtime")
    take = bot.act(state)
    assert take is not None
    bot.observe([*did, ("robot4", take, True)])
    pause = 0
    while bot.act(state) is None:
        pause += 1
        bot.observe([])
    return pause


def test_several_bots_rest_less_next_to_a_person_who_works() -> None:
    world = World(load_task("multi_agent/10@4"))
    walk = next(a for a in world.initial.actions("robot1") if a.destination)
    work = world.action("pick-up-item", "robot1", "tomato1", "table2")
    long, short = pause_after_work([]), pause_after_work([("robot1", work, True)])
    assert pause_after_work([("robot1", walk, True)]) == long
    assert pause_after_work([("robot1", work, False)]) == long
    assert pause_after_work([("robot2", work, True)]) == long
    assert short < long


def test_unknown_skill_is_named() -> None:
    with pytest.raises(RobotouilleError, match="did you mean 'expert'"):
        skill_named("expart")
    assert str(SKILLS["partner"]) == "reaction=0.4 pace=0.8 rest=0.3 slips=0.02"


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", quick_sample(["01", "02", "03", "04", "05", "06", "07", "08", "09", "10"], 4)
)
def test_help_shortens_a_game_with_a_partner(task: str) -> None:
    idle = play(Setting(f"multi_agent/{task}", 2, "idle", "partner", 0))
    helped = play(Setting(f"multi_agent/{task}", 2, "helpful", "partner", 0))
    assert helped.won
    assert helped.steps < idle.steps


@pytest.mark.slow
def test_help_pays_next_to_two_partners() -> None:
    games = [
        play(Setting("multi_agent/07", 3, person, "partner", seed))
        for person in ("idle", "helpful")
        for seed in range(4)
    ]
    idle, helped = games[:4], games[4:]
    assert all(game.won and not game.fault for game in games)
    assert sum(game.steps for game in helped) < 0.93 * sum(game.steps for game in idle)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "seats", "person"),
    quick_sample(
        [
            ("06", 4, "hoarding"),
            *((n, 3, who) for n in ("01", "03", "07", "09") for who in ("wandering", "hoarding")),
        ],
        5,
    ),
)
def test_partners_never_stand_still_while_work_is_possible(
    task: str, seats: int, person: str
) -> None:
    report = play(Setting(f"multi_agent/{task}", seats, person, "partner", 0))
    assert report.won
    assert not [each for each in report.stood if each.work]


@pytest.mark.slow
def test_partners_work_for_other_orders_while_a_person_stands_at_the_stove() -> None:
    report = play(Setting("shifts/03_one_stove", 2, "at_stove", "partner", 0))
    assert report.points is not None and report.points > 0
    assert not report.fault


@pytest.mark.slow
def test_a_third_partner_helps_in_a_shift() -> None:
    two, three = (
        play(Setting("shifts/02_burger_stand", seats, "nobody", "partner", 0)) for seats in (2, 3)
    )
    assert two.points is not None and three.points is not None
    assert three.points >= two.points
