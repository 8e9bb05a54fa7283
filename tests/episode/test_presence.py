"""Absence rules: wait, pause, bot and end."""

from __future__ import annotations

import pytest

from robotouille import World
from robotouille.episode import (
    Absence,
    ActionRequest,
    Clock,
    Controller,
    Episode,
    Paused,
    PauseReason,
    Phase,
    Reason,
    Resumed,
    Rules,
    SeatChanged,
    Stepped,
)
from tests.support import episodes
from tests.support.episodes import TWO, outcome, steps

THREE = World("training/03_multi_agent@3")


def start(absence: Absence, clock: Clock = Clock.REALTIME, **rules: object) -> Episode:
    options = {"step_rate": 10.0, "grace": 30.0, **rules}
    return episodes.start(kind="human", clock=clock, absence=absence, **options)


class TestWait:
    def test_game_goes_on_and_the_seat_does_nothing(self) -> None:
        episode = start(Absence.WAIT)
        episode.set_present("robot2", False, 1.0)
        assert episode.seat("robot2").controller is Controller.ABSENT
        episode.tick(2.0)
        assert len(steps(episode)) == 10

    def test_seat_is_free_after_the_grace(self) -> None:
        episode = start(Absence.WAIT)
        episode.set_present("robot2", False, 1.0)
        episode.tick(30.9)
        assert episode.seat("robot2").taken
        episode.tick(31.0)
        roster = [e for e in episode.events() if isinstance(e, SeatChanged)]
        assert (roster[-1].player, roster[-1].taken, roster[-1].controller) == (
            "robot2",
            False,
            "",
        )
        assert episode.join(None, "carol", "human", 32.0) == "robot2"


class TestPause:
    def test_game_is_paused_until_the_return(self) -> None:
        episode = start(Absence.PAUSE)
        episode.tick(0.1)
        episode.events()
        episode.set_present("robot2", False, 1.0)
        assert episode.paused
        assert episode.pauses.shown == (PauseReason.ABSENCE, 31.0)
        episode.tick(20.0)
        events = episode.events()
        assert [e.reasons for e in events if isinstance(e, Paused)] == [("absence",)]
        assert not any(isinstance(e, Stepped) for e in events)
        episode.set_present("robot2", True, 21.0)
        assert any(isinstance(e, Resumed) for e in episode.events())
        episode.tick(21.05)
        assert not steps(episode)
        episode.tick(21.1)
        assert len(steps(episode)) == 1

    def test_game_is_abandoned_after_the_grace(self) -> None:
        episode = start(Absence.PAUSE)
        episode.set_present("robot2", False, 1.0)
        episode.tick(31.0)
        assert outcome(episode) == (Reason.ABANDONED, "ROBOT2 did not come back")

    def test_action_during_the_pause_is_kept(self) -> None:
        episode = start(Absence.PAUSE)
        episode.set_present("robot2", False, 1.0)
        move = next(a for a in episode.state.actions("robot1") if a.name == "move")
        episode.submit("robot1", ActionRequest(1, move), 2.0)
        episode.set_present("robot2", True, 3.0)
        episode.tick(3.1)
        (step,) = steps(episode)
        assert [m.action for m in step.moves] == [move]

    def test_lockstep_takes_no_step_during_the_absence(self) -> None:
        episode = start(Absence.PAUSE, Clock.LOCKSTEP)
        episode.submit("robot1", ActionRequest(1), 0.5)
        episode.set_present("robot2", False, 1.0)
        assert episode.step == 0
        episode.set_present("robot2", True, 2.0)
        episode.submit("robot2", ActionRequest(1), 2.5)
        assert episode.step == 1


class TestBot:
    def test_substitute_plays_until_the_return(self) -> None:
        episode = start(Absence.BOT)
        episode.set_present("robot2", False, 1.0)
        assert episode.seat("robot2").controller is Controller.SUBSTITUTE
        move = next(a for a in episode.state.actions("robot2") if a.name == "move")
        episode.substitute("robot2", move, 1.05)
        episode.tick(1.1)
        moves = [move for step in steps(episode) for move in step.moves]
        assert [(m.player, m.seq) for m in moves] == [("robot2", 0)]
        episode.set_present("robot2", True, 2.0)
        assert episode.seat("robot2").controller is Controller.HUMAN
        episode.substitute("robot2", move, 2.05)
        episode.tick(2.1)
        assert not any(step.moves for step in steps(episode))

    def test_pending_action_of_the_substitute_is_dropped_at_the_return(self) -> None:
        episode = start(Absence.BOT, Clock.LOCKSTEP)
        episode.set_present("robot2", False, 1.0)
        move = next(a for a in episode.state.actions("robot2") if a.name == "move")
        episode.substitute("robot2", move, 1.1)
        episode.set_present("robot2", True, 1.2)
        episode.submit("robot1", ActionRequest(1), 1.3)
        assert episode.step == 0
        episode.submit("robot2", ActionRequest(1), 1.4)
        assert [step.moves for step in steps(episode)] == [()]

    def test_seat_is_kept_without_limit(self) -> None:
        episode = start(Absence.BOT)
        episode.set_present("robot2", False, 1.0)
        episode.tick(40.0)
        assert episode.phase is Phase.RUNNING
        assert episode.seat("robot2").taken

    def test_lockstep_waits_for_the_substitute(self) -> None:
        episode = start(Absence.BOT, Clock.LOCKSTEP)
        episode.set_present("robot2", False, 1.0)
        episode.submit("robot1", ActionRequest(1), 1.1)
        assert episode.step == 0
        episode.substitute("robot2", None, 1.2)
        assert episode.step == 1

    def test_substitutes_actions_do_not_answer_the_participants_requests(self) -> None:
        episode = start(Absence.BOT)
        episode.submit("robot2", ActionRequest(7), 0.05)
        episode.tick(0.1)
        answer = episode.seat("robot2").answer
        episode.set_present("robot2", False, 0.15)
        episode.substitute("robot2", episode.state.actions("robot2")[0], 0.16)
        episode.tick(0.2)
        assert episode.seat("robot2").answer == answer
        assert answer.seq == 7


class TestEnd:
    def test_game_ends_after_the_grace(self) -> None:
        episode = start(Absence.END)
        episode.set_present("robot2", False, 1.0)
        episode.tick(30.9)
        assert episode.outcome is None
        episode.tick(31.0)
        assert outcome(episode)[0] is Reason.ABANDONED

    def test_game_ends_at_once_if_a_participant_leaves(self) -> None:
        episode = start(Absence.END)
        episode.leave("robot2", 1.0)
        assert outcome(episode) == (Reason.ABANDONED, "ROBOT2 left")


@pytest.mark.parametrize("absence", list(Absence))
def test_deserted_game_is_abandoned_after_the_grace(absence: Absence) -> None:
    episode = start(absence)
    for player in TWO.players:
        episode.set_present(player, False, 1.0)
    episode.events()
    episode.tick(30.9)
    assert not steps(episode)
    episode.tick(31.0)
    assert outcome(episode) == (Reason.ABANDONED, "everybody left")


class TestSeveralSeats:
    """One participant has several seats."""

    def game(self, **rules: object) -> Episode:
        episode = Episode(THREE, Rules(**rules), 0.0)  # type: ignore[arg-type]
        episode.join_several(["robot1", "robot3"], "ada", "model", 0.0, session="a")
        episode.join(None, "bob", "human", 0.0, session="b")
        episode.events()
        return episode

    def roster(self, episode: Episode) -> list[tuple[str, bool, str]]:
        events = [event for event in episode.events() if isinstance(event, SeatChanged)]
        return [(event.player, event.taken, event.controller.value) for event in events]

    def test_no_seat_acts_before_all_are_back(self) -> None:
        """It is the turn of robot3 when ada comes back: robot1, which is back first, is not to
        let time run without it.
        """
        episode = self.game(clock=Clock.TURN)
        for player in ("robot1", "robot2"):
            episode.submit(player, ActionRequest(1), 1.0)
        assert episode.on_turn == "robot3"
        episode.set_present("robot2", False, 2.0)
        episode.set_present(("robot1", "robot3"), False, 2.0)
        assert episode.paused
        episode.events()
        episode.set_present(("robot1", "robot3"), True, 3.0, generation=1)
        assert episode.running
        assert steps(episode) == []
        assert [episode.seat(player).generation for player in THREE.players] == [1, 0, 1]

    def test_all_seats_are_free_after_the_grace(self) -> None:
        episode = self.game(clock=Clock.LOCKSTEP, absence=Absence.WAIT, grace=10.0)
        episode.set_present(("robot1", "robot3"), False, 1.0)
        assert self.roster(episode) == [("robot1", True, "absent"), ("robot3", True, "absent")]
        episode.tick(11.0)
        assert self.roster(episode) == [("robot1", False, ""), ("robot3", False, "")]
        assert episode.record.free_seats() == ("robot1", "robot3")

    def test_leaving_several_seats_ends_the_game_once(self) -> None:
        episode = self.game(absence=Absence.END)
        episode.leave(("robot1", "robot3"), 1.0)
        assert outcome(episode) == (Reason.ABANDONED, "ada left")
        assert self.roster(episode) == [("robot1", False, ""), ("robot3", False, "")]
