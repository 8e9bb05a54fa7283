"""A game in this process: counted down to, and won or not."""

from __future__ import annotations

from robotouille import World, load_task
from robotouille.episode import Clock, Episode, Rules
from robotouille.planning.policies.policy import RandomPolicy
from robotouille_client.cli.play import NO_CERTIFICATE, step_limit
from robotouille_client.window.sources.local import LocalSource

RULES = Rules(clock=Clock.REALTIME, step_rate=10.0, max_steps=5, countdown=3.0)


class Timer:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def source(timer: Timer, rules: Rules = RULES) -> LocalSource:
    world = World("multi_agent/02")
    bots = {player: ("bot", RandomPolicy(player, 1)) for player in world.players[1:]}
    return LocalSource(Episode(world, rules, timer()), world.players[0], bots, timer)


def test_it_is_counted_down_to() -> None:
    timer = Timer()
    game = source(timer)
    assert (game.view().starts_in, game.view().status) == (3.0, "Starts in 3")
    timer.now = 2.5
    assert (game.view().starts_in, game.view().step) == (0.5, 0)
    timer.now = 3.1
    view = game.view()
    assert (view.starts_in, view.status) == (None, "")


def test_out_of_steps_is_not_won() -> None:
    timer = Timer()
    game = source(timer)
    game.view()
    timer.now = 3.0
    game.view()
    timer.now = 4.0
    view = game.view()
    assert view.outcome == "Out of steps after 5 steps"
    assert not view.won


def test_the_step_limit_of_a_game_here() -> None:
    task = load_task("multi_agent/01", timing="people")
    assert step_limit(task, Clock.REALTIME, 10.0) == 1800
    assert step_limit(task, Clock.TURN, 10.0) == 210
    unknown = load_task("examples/pancakes", timing="people")
    assert step_limit(unknown, Clock.REALTIME, 5.0) == NO_CERTIFICATE
