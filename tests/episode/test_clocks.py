"""Clocks: due steps, turns and awaited seats, alone and in an episode."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from robotouille.episode import ActionRejected, ActionRequest, Clock, Rules
from robotouille.episode.clocks import (
    MAX_CATCH_UP,
    MAX_LATE_AT_ONCE,
    MAX_STEPS_AT_ONCE,
    DeclaredClock,
    LockstepClock,
    RealTimeClock,
)
from tests.support.episodes import first, start, steps

PLAYERS = ("ada", "bob")


class Decided:
    """Game in which everybody has always decided."""

    step, running = 0, True

    def all_decided(self, players: Iterable[str]) -> bool:
        return True


def test_long_runs_of_steps_continue_at_the_next_tick() -> None:
    clock, game = LockstepClock(Rules(), PLAYERS), Decided()
    assert len(list(clock.on_decision(3.0, game))) == MAX_STEPS_AT_ONCE
    assert (clock.due(), clock.behind) == (3.0, True)
    assert len(list(clock.on_tick(4.0, game))) == MAX_STEPS_AT_ONCE
    game.running = False
    assert not list(clock.on_tick(5.0, game))
    assert not clock.behind


def test_late_steps_in_real_time_continue_at_the_next_tick() -> None:
    clock, game = RealTimeClock(Rules(clock=Clock.REALTIME, step_rate=10)), Decided()
    clock.start(0.0)
    taken: list[float] = []
    for _ in range(MAX_CATCH_UP // MAX_LATE_AT_ONCE):
        assert not taken or clock.behind
        taken += clock.on_tick(100.0, game)
    assert taken == pytest.approx([step / 10 for step in range(1, MAX_CATCH_UP + 1)])
    assert (clock.due(), clock.behind) == (pytest.approx(100.1), False)


def test_pause_ends_the_backlog_of_real_time() -> None:
    clock, game = RealTimeClock(Rules(clock=Clock.REALTIME, step_rate=10)), Decided()
    clock.start(0.0)
    assert len(list(clock.on_tick(0.55, game))) == MAX_LATE_AT_ONCE
    clock.resume(7.0)
    assert (clock.due(), clock.behind) == (pytest.approx(7.1), False)


def test_only_declared_thinking_delays_an_action() -> None:
    rules = Rules(clock=Clock.REALTIME, thinking="declared", step_rate=10.0)
    assert [DeclaredClock(rules, PLAYERS).delay(ms) for ms in (0, 1, 100, 250)] == [0, 1, 1, 3]
    assert LockstepClock(rules, PLAYERS).delay(250) == RealTimeClock(rules).delay(250) == 0


class TestTurns:
    def test_one_seat_acts_in_each_step(self) -> None:
        episode = start(clock=Clock.TURN)
        assert episode.on_turn == "robot1"
        episode.submit("robot1", ActionRequest(1, first(episode, "robot1")), 1.0)
        assert episode.step == 1
        assert episode.on_turn == "robot2"
        episode.submit("robot2", ActionRequest(1), 2.0)
        assert (episode.step, episode.on_turn) == (2, "robot1")

    def test_action_out_of_turn_is_rejected(self) -> None:
        episode = start(clock=Clock.TURN)
        episode.submit("robot2", ActionRequest(1, first(episode, "robot2")), 1.0)
        rejected = [e for e in episode.events() if isinstance(e, ActionRejected)]
        assert rejected[0].reasons == ("it is robot1's turn",)
        assert episode.step == 0

    def test_slow_seat_loses_its_turn_after_the_budget(self) -> None:
        episode = start(clock=Clock.TURN, move_budget=5.0)
        assert episode.due() == 5.0
        episode.tick(4.999)
        assert episode.step == 0
        episode.tick(5.0)
        assert (episode.step, episode.on_turn) == (1, "robot2")
        assert episode.due() == 10.0

    def test_absent_seat_loses_its_turn(self) -> None:
        episode = start(clock=Clock.TURN)
        episode.set_present("robot2", False, 0.5)
        episode.submit("robot1", ActionRequest(1), 1.0)
        assert (episode.step, episode.on_turn) == (2, "robot1")


class TestLockstep:
    def test_step_is_taken_when_all_have_decided(self) -> None:
        episode = start()
        episode.submit("robot2", ActionRequest(1, first(episode, "robot2")), 1.0)
        assert episode.step == 0
        episode.submit("robot1", ActionRequest(1, first(episode, "robot1")), 2.0)
        assert episode.step == 1
        # In seat order, whoever was first.
        assert [m.player for m in steps(episode)[0].moves] == ["robot1", "robot2"]

    def test_step_is_taken_when_the_budget_is_used_up(self) -> None:
        episode = start(move_budget=3.0)
        episode.submit("robot2", ActionRequest(1, first(episode, "robot2")), 1.0)
        episode.tick(3.0)
        assert [m.player for m in steps(episode)[0].moves] == ["robot2"]


class TestRealTime:
    def test_schedule_does_not_drift(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        assert episode.due() == pytest.approx(0.1)
        episode.tick(0.35)
        assert episode.step == 3
        assert episode.due() == pytest.approx(0.4)

    def test_actions_apply_in_order_of_arrival(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        episode.submit("robot2", ActionRequest(1, first(episode, "robot2")), 0.01)
        episode.submit("robot1", ActionRequest(1, first(episode, "robot1")), 0.02)
        episode.tick(0.1)
        assert [m.player for m in steps(episode)[0].moves] == ["robot2", "robot1"]

    def test_steps_are_skipped_after_a_stall(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        episode.tick(100.0)
        assert (episode.step, episode.waits_for) == (MAX_CATCH_UP, ())
        assert episode.due() == pytest.approx(100.1)

    def test_actions_apply_in_seat_order_with_declared_thinking(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10, thinking="declared")
        episode.submit("robot2", ActionRequest(1, first(episode, "robot2")), 0.01)
        episode.submit("robot1", ActionRequest(1, first(episode, "robot1")), 0.02)
        assert [m.player for m in steps(episode)[0].moves] == ["robot1", "robot2"]

    def test_declared_thinking_delays_the_action(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10, thinking="declared")
        assert episode.due() is None
        episode.submit("robot1", ActionRequest(1, first(episode, "robot1"), think_ms=250), 50.0)
        assert episode.step == 0
        episode.submit("robot2", ActionRequest(1, first(episode, "robot2"), think_ms=0), 99.0)
        # robot2 acts at once and is asked again; robot1's move is due three steps later.
        assert episode.step == 1
        for seq in (2, 3, 4):
            episode.submit("robot2", ActionRequest(seq), 100.0)
        assert episode.step == 4
        moved = [m.player for e in steps(episode) for m in e.moves]
        assert moved == ["robot2", "robot1"]
