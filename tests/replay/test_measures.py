"""Measures of episodes."""

from __future__ import annotations

from robotouille import World
from robotouille.certification.step_limit import plan_beside
from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.planning import solve
from robotouille.replay import Recording, SeatMeasures
from robotouille.replay.container import frame_ends, pack_frame
from robotouille.replay.measures import rejections
from robotouille.replay.model_calls import CallNotes, model_calls
from robotouille.replay.recorder import Recorder, header
from tests.support.games import record, recorded_game

WORLD = World("synchronous/01")


def recorded(*, to_the_goal: bool) -> Recording:
    """Record a plan with a chat message, an invalid action and a malformed one."""
    rules = Rules(max_steps=20)
    episode = Episode(WORLD, rules)
    episode.join("robot1", "ada", "model", 0.0)
    episode.submit("robot1", ActionRequest(1, "place-item(robot1, cheese1, table1)"), 1.0)
    episode.submit("robot1", ActionRequest(2, "juggle"), 2.0)
    episode.say("ada", "robot1", "oops", 2.0)
    plan = solve(WORLD).plan
    assert plan is not None
    for seq, (action,) in enumerate(plan.steps[: None if to_the_goal else 5], 3):
        episode.submit("robot1", ActionRequest(seq, action), float(seq))
    return Recording(record(episode, episode.events()))


def test_episode_that_reached_its_goal() -> None:
    found = recorded(to_the_goal=True).measures()
    assert (found.task, found.clock) == (WORLD.task.name, Clock.LOCKSTEP)
    assert (found.success, found.reason, found.steps) == (True, "goal", 8)
    assert found.seconds == 10.0
    seat = found.seats["robot1"]
    assert (seat.name, seat.kind) == ("ada", "model")
    assert (seat.acted, seat.lost, seat.invalid, seat.malformed) == (8, 0, 1, 1)
    assert (seat.said, seat.idle, seat.rejected) == (1, 0, {"invalid": 1, "malformed": 1})
    assert seat.thinking > 0


def test_episode_in_progress() -> None:
    found = recorded(to_the_goal=False).measures()
    assert (found.success, found.reason, found.steps) == (False, "", 5)
    assert found.seats["robot1"].acted == 5


def test_actions_on_objects_that_were_created_during_the_episode() -> None:
    world = World("multi_agent/10@4")
    plan = plan_beside(world)
    assert plan is not None
    assert any("water2" in action.arguments for joint in plan for action in joint)
    episode = Episode(world, Rules(clock=Clock.REALTIME, step_rate=1.0))
    for player in world.players:
        episode.join(player, player, "bot", 0.0)
    now = 0
    # An episode rejects moves into places that a teammate leaves in the same step, so the actions
    # of each joint action follow one another here.
    for seq, action in enumerate((action for joint in plan for action in joint), 1):
        player = action.player or ""
        while episode.state.busy_steps(player):
            episode.tick(now := now + 1)
        episode.submit(player, ActionRequest(seq, action), now + 0.5)
        episode.tick(now := now + 1)
    # The recording has a world of its own, in which no second water was made.
    found = Recording(record(episode, episode.events())).measures()
    assert (found.success, found.steps) == (True, now)


def test_invented_players_are_not_counted() -> None:
    stream = recorded_game("synchronous/01", seed=1, steps=5)
    stranger = {"t": 0, "player": "robot9"}
    rejected = {"note": "rejected", **stranger, "seq": 1, "action": "wait", "reasons": ["no"]}
    call = CallNotes().note([("user", "hello")], answer="")
    noted = {"note": "noted", **stranger, "topic": "model-call", "text": call}
    notes = pack_frame({"kind": "notes", "notes": [rejected, noted]})
    *_, before_footer, _ = frame_ends(stream)
    forged = Recording(stream[:before_footer] + notes + stream[before_footer:])
    assert rejections(forged).keys() == {"robot1"}
    assert not list(model_calls(forged))


def test_seat_that_was_never_taken() -> None:
    rules = Rules()
    stream = Recorder(WORLD).begin(header(WORLD.task, rules, episode="e"))
    assert Recording(stream).measures().seats == {"robot1": SeatMeasures()}
