"""What a researcher wants to know of a recording at once."""

from __future__ import annotations

from robotouille import World
from robotouille.episode import Clock, Episode, Rules
from robotouille.planning import solve
from robotouille.replay import Recording, SeatMeasures
from robotouille.replay.recorder import Recorder, header

WORLD = World("synchronous/01")


def recorded(*, to_the_goal: bool) -> Recording:
    """A plan with a word, a slip and a blunder on the way."""
    rules = Rules(max_steps=20)
    episode, recorder = Episode(WORLD, rules), Recorder(WORLD)
    stream = recorder.begin(header(WORLD.task, rules, episode="e"))
    episode.join("robot1", "ada", "model", 0.0)
    episode.submit("robot1", 1, "place-item(robot1, cheese1, table1)", 1.0)
    episode.submit("robot1", 2, "juggle", 2.0)
    episode.say("ada", "robot1", "oops", 2.0)
    plan = solve(WORLD).plan
    assert plan is not None
    for seq, (action,) in enumerate(plan.steps[: None if to_the_goal else 5], 3):
        episode.submit("robot1", seq, action, float(seq))
    return Recording(stream + recorder.record(episode.events()))


def test_an_episode_that_reached_its_goal() -> None:
    found = recorded(to_the_goal=True).measures()
    assert (found.task, found.clock) == (WORLD.task.name, Clock.LOCKSTEP)
    assert (found.success, found.reason, found.steps) == (True, "goal", 8)
    assert found.seconds == 10.0
    seat = found.seats["robot1"]
    assert (seat.name, seat.kind) == ("ada", "model")
    assert (seat.acted, seat.lost, seat.invalid, seat.malformed) == (8, 0, 1, 1)
    assert (seat.said, seat.idle, seat.rejected) == (1, 0, {"invalid": 1, "malformed": 1})
    assert seat.thinking > 0


def test_an_episode_that_still_goes_on() -> None:
    found = recorded(to_the_goal=False).measures()
    assert (found.success, found.reason, found.steps) == (False, "", 5)
    assert found.seats["robot1"].acted == 5


def test_a_seat_that_nobody_took() -> None:
    rules = Rules()
    stream = Recorder(WORLD).begin(header(WORLD.task, rules, episode="e"))
    assert Recording(stream).measures().seats == {"robot1": SeatMeasures()}
