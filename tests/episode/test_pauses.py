"""Pauses: their reasons, ends and priorities."""

from __future__ import annotations

from robotouille.episode import Absence, Clock, Episode, EpisodeEnded, PauseReason
from tests.support import episodes
from tests.support.episodes import steps


def start(absence: Absence) -> Episode:
    return episodes.start(
        kind="human", clock=Clock.REALTIME, step_rate=10.0, grace=30.0, absence=absence
    )


class TestOperator:
    def test_pause_lasts_until_it_is_lifted(self) -> None:
        episode = start(Absence.WAIT)
        episode.pause(PauseReason.OPERATOR, 1.0)
        episode.tick(500.0)
        assert not steps(episode)
        episode.resume(PauseReason.OPERATOR, 500.0)
        episode.tick(500.1)
        assert len(steps(episode)) == 1

    def test_absent_participant_has_the_whole_grace_after_a_pause(self) -> None:
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

    def test_two_reasons_at_once(self) -> None:
        episode = start(Absence.PAUSE)
        episode.set_present("robot2", False, 1.0)
        episode.pause(PauseReason.OPERATOR, 2.0)
        episode.set_present("robot2", True, 3.0)
        assert episode.paused
        episode.resume(PauseReason.OPERATOR, 4.0)
        assert (episode.paused, episode.pauses.shown) == (False, None)

    def test_end_lifts_all_reasons(self) -> None:
        episode = start(Absence.WAIT)
        episode.pause(PauseReason.OPERATOR, 1.0)
        episode.abort(2.0, "enough")
        assert any(isinstance(e, EpisodeEnded) for e in episode.events())
        assert (episode.paused, episode.due()) == (False, None)
