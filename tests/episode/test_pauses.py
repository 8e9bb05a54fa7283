"""Why time stands still: reasons that begin and end by themselves, and which of them counts."""

from __future__ import annotations

from robotouille.episode import Absence, Clock, Ended, Episode, PauseReason
from robotouille.episode.pauses import PauseReasons
from tests.support import episodes
from tests.support.episodes import steps


def start(absence: Absence) -> Episode:
    return episodes.start(
        kind="human", clock=Clock.REALTIME, step_rate=10.0, grace=30.0, absence=absence
    )


class TestOperator:
    def test_a_pause_lasts_until_it_is_lifted(self) -> None:
        episode = start(Absence.WAIT)
        episode.pause(PauseReason.OPERATOR, 1.0)
        episode.tick(500.0)
        assert not steps(episode)
        episode.resume(PauseReason.OPERATOR, 500.0)
        episode.tick(500.1)
        assert len(steps(episode)) == 1

    def test_in_it_nobody_loses_a_seat_and_has_the_whole_grace_afterwards(self) -> None:
        episode = start(Absence.PAUSE)
        episode.pause(PauseReason.OPERATOR, 1.0)
        episode.set_present("robot2", False, 2.0)
        episode.tick(400.0)
        assert episode.outcome is None
        episode.resume(PauseReason.OPERATOR, 500.0)
        assert episode.due() == 530.0
        episode.tick(529.0)
        assert episode.outcome is None
        episode.tick(530.0)
        assert episode.outcome is not None

    def test_two_reasons_at_a_time(self) -> None:
        episode = start(Absence.PAUSE)
        episode.set_present("robot2", False, 1.0)
        episode.pause(PauseReason.OPERATOR, 2.0)
        episode.set_present("robot2", True, 3.0)
        assert episode.paused
        episode.resume(PauseReason.OPERATOR, 4.0)
        assert not episode.paused

    def test_an_end_lifts_all(self) -> None:
        episode = start(Absence.WAIT)
        episode.pause(PauseReason.OPERATOR, 1.0)
        episode.abort(2.0, "enough")
        assert any(isinstance(e, Ended) for e in episode.events())
        assert (episode.paused, episode.due()) == (False, None)


class TestReasons:
    def test_the_first_to_tell_is_the_one_that_somebody_decided_on(self) -> None:
        reasons = PauseReasons({PauseReason.DESERTED: 9.0, PauseReason.OPERATOR: None})
        assert reasons.shown == (PauseReason.OPERATOR, None)
        assert PauseReasons().shown is None

    def test_while_another_reason_applies_no_absence_comes_to_its_end(self) -> None:
        reasons = PauseReasons({PauseReason.ABSENCE: 5.0})
        assert (reasons.outer, reasons.due(), reasons.expired(5.0)) == (
            False,
            5.0,
            [PauseReason.ABSENCE],
        )
        reasons.until[PauseReason.RESTART] = 8.0
        assert (reasons.outer, reasons.due(), reasons.expired(7.0)) == (True, 8.0, [])
        assert reasons.expired(8.0) == [PauseReason.RESTART]
