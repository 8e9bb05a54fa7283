"""Transitions of recordings."""

from __future__ import annotations

import pytest

from robotouille import State, World
from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.planning import solve
from robotouille.replay import Recording
from robotouille.world.grounding.objects import Atom
from tests.support.games import record

TEAM = World("multi_agent/01")
BAD = "place-item(robot1, lettuce1, table1)"


def recorded(world: World, rules: Rules) -> Recording:
    """Play an invalid action, a malformed one, a lost race, and a decision to do nothing."""
    episode = Episode(world, rules)
    for player in world.players:
        episode.join(player, player.upper(), "model", 0.0)
    episode.submit("robot1", ActionRequest(1, BAD, reasoning="I hold it, I think"), 1.0)
    episode.submit("robot1", ActionRequest(2, "fly to the moon"), 1.5)
    first, second = (episode.state.actions(player) for player in world.players)
    place = next(a for a in first if a.name == "move")
    same = next((a for a in second if a.arguments[2:] == place.arguments[2:]), None)
    episode.submit("robot1", ActionRequest(3, place, reasoning="over there"), 2.0)
    episode.submit("robot2", ActionRequest(1, same), 2.5)
    episode.submit("robot1", ActionRequest(4), 3.0)
    episode.submit("robot2", ActionRequest(2, episode.state.actions("robot2")[0]), 4.0)
    episode.say("ROBOT2", "robot2", "hello", 4.5)
    episode.abort(5.0, "enough")
    return Recording(record(episode, episode.events()))


@pytest.fixture(scope="module")
def recording() -> Recording:
    return recorded(TEAM, Rules(clock=Clock.LOCKSTEP, max_steps=9))


def test_all_requests_in_order(recording: Recording) -> None:
    rows = list(recording.transitions())
    assert [(row.step, row.seat, row.valid, row.action is None) for row in rows] == [
        (1, "robot1", False, False),
        (1, "robot1", False, True),
        (1, "robot1", True, False),
        (1, "robot2", False, False),
        (2, "robot2", True, False),
        (2, "robot1", True, True),
    ]
    assert [row.seq for row in rows] == [1, 2, 3, 1, 2, 4]
    assert rows[0].reasoning == "I hold it, I think" and rows[0].reasons
    assert str(rows[0].action) == BAD
    assert rows[1].text == "fly to the moon"
    assert rows[2].reasoning == "over there" and not rows[2].reasons
    assert rows[3].reasons and rows[3].time >= rows[1].time


def test_states_before_and_after_the_step(recording: Recording) -> None:
    states = dict(recording.states())
    for row in recording.transitions():
        assert row.state == states[row.step - 1]
        taken = row.valid or row.text == ""
        assert row.next_state == (states[row.step] if taken or row.seat == "robot2" else row.state)
        assert row.reward == 0.0
        if row.valid and row.action is not None:
            assert row.action in row.state.actions(row.seat)


def test_step_that_reaches_the_goal_is_rewarded() -> None:
    world = World("synchronous/01")
    rules = Rules()
    episode = Episode(world, rules)
    episode.join("robot1", "ada", "bot", 0.0)
    plan = solve(world).plan
    assert plan is not None
    for seq, (action,) in enumerate(plan, 1):
        episode.submit("robot1", ActionRequest(seq, action), float(seq))
    rows = list(Recording(record(episode, episode.events())).transitions())
    assert [row.reward for row in rows] == [0.0] * 7 + [1.0]


def test_random_reversals_are_in_the_next_state() -> None:
    world = World("synchronous/01")

    def undone(state: State) -> list[Atom]:
        return [atom for atom in state.atoms() if atom[0] == "has_item"]

    rules = Rules()
    episode = Episode(world, rules, random_reversal=undone)
    episode.join("robot1", "ada", "bot", 0.0)
    for seq, name in enumerate(("move", "pick-up-item", "wait"), 1):
        actions = episode.state.actions("robot1")
        wanted = [a for a in actions if a.name == name and "table1" in a.arguments[2:]]
        episode.submit("robot1", ActionRequest(seq, (wanted or list(actions[-1:]))[0]), float(seq))
    recording = Recording(record(episode, episode.events()))
    rows = list(recording.transitions())
    states = [state for _, state in recording.states()]
    assert [row.state for row in rows] == states[:-1]
    assert [row.next_state for row in rows] == states[1:]
    assert rows[1].action is not None and rows[1].action.name == "pick-up-item"
    assert not any(atom[0] == "has_item" for atom in rows[1].next_state.atoms())


def test_staleness_counts_from_the_basis() -> None:
    episode = Episode(TEAM, Rules(clock=Clock.LOCKSTEP, max_steps=9))
    for player in TEAM.players:
        episode.join(player, player.upper(), "model", 0.0)
    for seq, basis in enumerate((0, 0, None), start=1):
        for player in TEAM.players:
            action = next(a for a in episode.state.actions(player) if a.name in ("move", "wait"))
            mine = basis if player == "robot1" else None
            episode.submit(player, ActionRequest(seq, action, basis=mine), float(seq))
    episode.abort(5.0, "enough")
    recording = Recording(record(episode, episode.events()))
    mine = [row for row in recording.transitions() if row.seat == "robot1"]
    assert [row.staleness for row in mine] == [0, 1, None]
    seats = recording.measures().seats
    assert seats["robot1"].staleness == 0.5 and seats["robot2"].staleness is None
