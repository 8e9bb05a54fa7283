"""When a step is due, who may act, and whom it waits for: each clock alone, and in an episode."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from robotouille import World
from robotouille.episode import Clock, Rejected, Rules, Stepped
from robotouille.episode.clocks import (
    MAX_CATCH_UP,
    MAX_STEPS_AT_ONCE,
    DeclaredClock,
    LockstepClock,
    RealTimeClock,
    TurnClock,
    clock_for,
)
from tests.support.episodes import first, start, steps
from tests.support.games import play_through, random_choice

PLAYERS = ("ada", "bob")


class Board:
    """A game of which only this is known: who has decided."""

    def __init__(self, *decided: str, running: bool = True) -> None:
        self.step = 0
        self.running = running
        self.decided = set(decided)

    def all_decided(self, players: Iterable[str]) -> bool:
        return self.decided.issuperset(players)

    def take(self, times: Iterable[float], *, forget: bool = True) -> list[float]:
        """Take the steps of these times; whoever has decided has to decide anew."""
        taken = []
        for time in times:
            taken.append(time)
            self.step += 1
            if forget:
                self.decided.clear()
        return taken


@pytest.mark.parametrize(
    ("rules", "kind"),
    [
        (Rules(clock=Clock.TURN), TurnClock),
        (Rules(clock=Clock.LOCKSTEP), LockstepClock),
        (Rules(clock=Clock.REALTIME), RealTimeClock),
        (Rules(clock=Clock.REALTIME, thinking="declared"), DeclaredClock),
        (Rules(clock=Clock.LOCKSTEP, thinking="declared"), LockstepClock),
    ],
)
def test_every_rule_has_its_clock(rules: Rules, kind: type) -> None:
    clock = clock_for(rules, PLAYERS)
    assert type(clock) is kind
    assert clock.scheduled == rules.scheduled


class TestWaitingClocks:
    def test_lockstep_waits_for_all_and_lets_all_act(self) -> None:
        clock = LockstepClock(Rules(), PLAYERS)
        assert (clock.awaited(0), clock.on_turn(0), clock.due()) == (PLAYERS, None, None)
        board = Board("ada")
        assert board.take(clock.on_decision(1.0, board)) == []
        board.decided.add("bob")
        assert board.take(clock.on_decision(2.0, board)) == [2.0]

    def test_turns_wait_for_one_after_the_other(self) -> None:
        clock = TurnClock(Rules(), PLAYERS)
        assert [clock.on_turn(step) for step in range(3)] == ["ada", "bob", "ada"]
        assert [clock.awaited(step) for step in range(2)] == [("ada",), ("bob",)]
        board = Board("bob")
        assert board.take(clock.on_decision(1.0, board)) == []
        board.decided.add("ada")
        assert board.take(clock.on_decision(1.0, board), forget=False) == [1.0] * MAX_STEPS_AT_ONCE

    def test_the_budget_of_a_move_ends_it(self) -> None:
        clock = LockstepClock(Rules(move_budget=5.0), PLAYERS)
        board = Board()
        clock.start_move(10.0)
        assert clock.due() == 15.0
        assert board.take(clock.on_tick(14.9, board)) == []
        assert board.take(clock.on_tick(15.0, board)) == [15.0]

    def test_where_nobody_needs_to_be_waited_for_the_rest_comes_with_the_next_tick(self) -> None:
        clock = LockstepClock(Rules(), PLAYERS)
        board = Board(*PLAYERS)
        taken = board.take(clock.on_decision(3.0, board), forget=False)
        assert len(taken) == MAX_STEPS_AT_ONCE
        assert clock.due() == 3.0
        assert len(board.take(clock.on_tick(4.0, board), forget=False)) == MAX_STEPS_AT_ONCE
        board.decided.clear()
        assert board.take(clock.on_tick(5.0, board)) == []
        assert clock.due() is None

    def test_a_game_that_stands_still_takes_no_step(self) -> None:
        clock = LockstepClock(Rules(), PLAYERS)
        board = Board(*PLAYERS, running=False)
        assert board.take(clock.on_decision(3.0, board)) == []
        assert clock.due() is None

    def test_only_declared_time_is_charged(self) -> None:
        rules = Rules(clock=Clock.REALTIME, thinking="declared", step_rate=10.0)
        assert [DeclaredClock(rules, PLAYERS).delay(ms) for ms in (0, 1, 100, 250)] == [0, 1, 1, 3]
        assert LockstepClock(rules, PLAYERS).delay(250) == RealTimeClock(rules).delay(250) == 0


class TestRealTimeAlone:
    def test_steps_come_whoever_has_decided(self) -> None:
        clock = RealTimeClock(Rules(clock=Clock.REALTIME, step_rate=2.0))
        clock.start(10.0)
        board = Board()
        assert (clock.due(), clock.awaited(0), clock.on_turn(0)) == (10.5, (), None)
        assert board.take(clock.on_decision(10.6, board)) == []
        assert board.take(clock.on_tick(11.2, board)) == [10.5, 11.0]
        assert clock.due() == 11.5

    def test_what_was_missed_is_left_out_after_some_steps(self) -> None:
        clock = RealTimeClock(Rules(clock=Clock.REALTIME, step_rate=10.0))
        clock.start(0.0)
        board = Board()
        assert len(board.take(clock.on_tick(100.0, board))) == MAX_CATCH_UP
        assert clock.due() == pytest.approx(100.1)

    def test_after_a_pause_a_whole_period_passes(self) -> None:
        clock = RealTimeClock(Rules(clock=Clock.REALTIME, step_rate=2.0))
        clock.start(0.0)
        clock.resume(7.0)
        assert clock.due() == 7.5
        clock.resume(7.1)
        assert clock.due() == pytest.approx(7.6)


class TestTurns:
    def test_seats_act_one_after_the_other_one_action_a_step(self) -> None:
        episode = start(clock=Clock.TURN)
        assert episode.on_turn == "robot1"
        episode.submit("robot1", 1, first(episode, "robot1"), 1.0)
        assert episode.step == 1
        assert episode.on_turn == "robot2"
        episode.submit("robot2", 1, None, 2.0)
        assert (episode.step, episode.on_turn) == (2, "robot1")

    def test_out_of_turn_is_rejected_and_changes_nothing(self) -> None:
        episode = start(clock=Clock.TURN)
        episode.submit("robot2", 1, first(episode, "robot2"), 1.0)
        rejected = [e for e in episode.events() if isinstance(e, Rejected)]
        assert rejected[0].reasons == ("it is robot1's turn",)
        assert episode.step == 0

    def test_a_slow_seat_loses_its_turn_after_the_budget(self) -> None:
        episode = start(clock=Clock.TURN, move_budget=5.0)
        assert episode.due() == 5.0
        episode.tick(4.999)
        assert episode.step == 0
        episode.tick(5.0)
        assert (episode.step, episode.on_turn) == (1, "robot2")
        assert episode.due() == 10.0

    def test_the_turn_of_an_absent_seat_passes(self) -> None:
        episode = start(clock=Clock.TURN)
        episode.set_present("robot2", False, 0.5)
        episode.submit("robot1", 1, None, 1.0)
        assert (episode.step, episode.on_turn) == (2, "robot1")


class TestLockstep:
    def test_a_step_when_all_have_acted(self) -> None:
        episode = start()
        episode.submit("robot2", 1, first(episode, "robot2"), 1.0)
        assert episode.step == 0
        episode.submit("robot1", 1, first(episode, "robot1"), 2.0)
        assert episode.step == 1
        # In seat order, whoever was first.
        assert [m.player for m in steps(episode)[0].moves] == ["robot1", "robot2"]

    def test_or_when_the_budget_is_used_up(self) -> None:
        episode = start(move_budget=3.0)
        episode.submit("robot2", 1, first(episode, "robot2"), 1.0)
        episode.tick(3.0)
        assert [m.player for m in steps(episode)[0].moves] == ["robot2"]


class TestRealTime:
    def test_steps_follow_an_absolute_schedule(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        assert episode.due() == pytest.approx(0.1)
        episode.tick(0.35)
        assert episode.step == 3
        assert episode.due() == pytest.approx(0.4)

    def test_order_of_arrival_decides(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        episode.submit("robot2", 1, first(episode, "robot2"), 0.01)
        episode.submit("robot1", 1, first(episode, "robot1"), 0.02)
        episode.tick(0.1)
        assert [m.player for m in steps(episode)[0].moves] == ["robot2", "robot1"]

    def test_after_a_stall_it_does_not_race(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10)
        episode.tick(100.0)
        assert episode.step <= 10
        assert episode.due() is not None
        assert episode.due() > 100.0

    def test_where_thinking_is_declared_seat_order_decides(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10, thinking="declared")
        episode.submit("robot2", 1, first(episode, "robot2"), 0.01)
        episode.submit("robot1", 1, first(episode, "robot1"), 0.02)
        assert [m.player for m in steps(episode)[0].moves] == ["robot1", "robot2"]

    def test_declared_thinking_time_is_charged_in_the_games_own_time(self) -> None:
        episode = start(clock=Clock.REALTIME, step_rate=10, thinking="declared")
        assert episode.due() is None
        episode.submit("robot1", 1, first(episode, "robot1"), 50.0, think_ms=250)
        assert episode.step == 0
        episode.submit("robot2", 1, first(episode, "robot2"), 99.0, think_ms=0)
        # robot2 acts at once and is asked again; robot1's move is due three steps later.
        assert episode.step == 1
        for seq in (2, 3, 4):
            episode.submit("robot2", seq, None, 100.0)
        assert episode.step == 4
        moved = [m.player for e in steps(episode) for m in e.moves]
        assert moved == ["robot2", "robot1"]


class TestClocksAgree:
    """One world, three clocks: the same joint actions lead to the same states."""

    def test_real_time_replays_a_lockstep_game(self) -> None:
        lockstep, events = play_through("multi_agent/02", Rules(max_steps=60), random_choice(8))
        game = [e for e in events if isinstance(e, Stepped)]
        episode = start(World("multi_agent/02"), clock=Clock.REALTIME, step_rate=10, max_steps=60)
        now = 0.0
        for seq, step in enumerate(game, 1):
            for move in step.moves:
                episode.submit(move.player, seq, move.action, now + 0.05)
            now += 0.1
            episode.tick(now + 1e-6)
            applied = [a.applied for e in steps(episode) for a in e.attempts]
            assert applied == [a.applied for a in step.attempts if a.applied] or applied == [
                a.applied for a in step.attempts
            ]
            assert episode.state.digest == step.state.digest
        assert episode.step == lockstep.step
