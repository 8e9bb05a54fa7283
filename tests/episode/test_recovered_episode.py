"""For whom, for what and how long a restored episode waits, and what it remembers as done."""

from __future__ import annotations

from robotouille.episode import Absence, Clock, Episode, PauseReason, Reason, Rules
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from tests.support.episodes import TWO, outcome

PATIENCE = 10.0


class Recorded:
    """A game of two people, and its recording."""

    def __init__(self, clock: Clock = Clock.REALTIME, **rules: object) -> None:
        options = {"step_rate": 10.0, "grace": 30.0, **rules}
        self.episode = Episode(TWO, Rules(clock=clock, **options), 0.0)
        head = header(TWO.task, self.episode.rules, episode="0123456789abcdef")
        self.recorder = Recorder(TWO)
        self.content = self.recorder.begin(head)
        for player in TWO.players:
            self.episode.join(player, player.upper(), "human", 0.0, session=f"s-{player}")

    def write(self) -> None:
        self.content += self.recorder.record(self.episode.events())

    def killed(self, now: float) -> Episode:
        """What the next process finds; it writes on in the same recording."""
        self.write()
        found = restore(Recording(self.content), now, PATIENCE)
        self.content = self.content[: found.kept] + found.missing
        self.episode = found.episode
        self.write()
        return found.episode


def test_an_operators_pause_outlives_a_restart() -> None:
    game = Recorded()
    game.episode.tick(2.0)
    game.episode.pause(PauseReason.OPERATOR, 2.0)
    episode = game.killed(100.0)
    for player in TWO.players:
        episode.set_present(player, True, 101.0)
    step = episode.step
    episode.tick(200.0)
    assert (episode.pauses.shown, episode.step) == ((PauseReason.OPERATOR, None), step)
    episode.resume(PauseReason.OPERATOR, 200.0)
    episode.tick(201.0)
    assert episode.step > step > 0


def test_after_two_crashes_in_a_row_all_are_waited_for() -> None:
    """Nobody had come back between them: that does not make anybody absent."""
    game = Recorded()
    game.episode.tick(2.0)
    game.killed(100.0)
    episode = game.killed(100.5)
    step = episode.step
    episode.set_present("robot1", True, 101.0)
    episode.tick(104.0)
    assert episode.pauses.shown == (PauseReason.RESTART, 100.5 + PATIENCE)
    assert episode.step == step > 0
    episode.set_present("robot2", True, 105.0)
    episode.tick(106.0)
    assert episode.step > step


def test_a_decision_to_do_nothing_is_taken_once() -> None:
    """Killed before it told the step: the clients send again what has no answer."""
    game = Recorded(Clock.LOCKSTEP)
    for player in TWO.players:
        game.episode.submit(player, 1, None, 1.0)
    assert game.episode.step == 1
    episode = game.killed(100.0)
    for player in TWO.players:
        episode.set_present(player, True, 101.0)
    for player in TWO.players:
        episode.submit(player, 1, None, 102.0)
    assert episode.step == 1
    for player in TWO.players:
        episode.submit(player, 2, None, 103.0)
    assert episode.step == 2


def test_who_was_away_has_the_whole_grace_after_a_restart() -> None:
    """While all are waited for, the countdown for one who was absent before does not run."""
    game = Recorded(grace=5.0, absence=Absence.PAUSE)
    game.episode.set_present("robot2", False, 1.0)
    episode = game.killed(100.0)
    episode.set_present("robot1", True, 107.0)
    episode.tick(107.0)
    assert episode.in_progress
    assert episode.pauses.shown == (PauseReason.ABSENCE, 112.0)
    episode.tick(112.0)
    assert outcome(episode)[0] is Reason.ABANDONED
