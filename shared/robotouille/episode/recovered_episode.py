"""An episode that another process began: brought to where its recording ends, then going on."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from robotouille.episode.episode import Episode
from robotouille.episode.episode_state import nothing_undone
from robotouille.episode.events import Moderation, Move, Outcome, Restarted
from robotouille.episode.lifecycle import PhaseEvent
from robotouille.episode.pauses import PauseReason
from robotouille.episode.seats import ActionAnswer
from robotouille.world.grounding.objects import Atom

__all__ = ["RecoveredEpisode"]


class RecoveredEpisode(Episode):
    """Takes what was recorded once more, without reporting it; then `resume_after_restart` or, if
    it had ended, `restore_ended`."""

    __slots__ = ()

    def replay_start(self) -> None:
        """Begin again, as recorded.

        Raises:
            IllegalEventError: It has begun already.
        """
        self._enter_phase(PhaseEvent.START)
        for seat in self.seats.values():
            seat.refused = False

    def replay_step(
        self,
        moves: Iterable[Move],
        idle: Iterable[tuple[str, int]] = (),
        undone: Sequence[Atom] = (),
        waits: Iterable[str] = (),
        *,
        time: float = 0.0,
    ) -> None:
        """Take a recorded step again.

        Args:
            moves: In the order in which they applied.
            idle: The decisions to do nothing: the seats with their sequence numbers.
            undone: What chance took back after it.
            waits: Who of those that did nothing said that they wait.
            time: Seconds since the game began.
        """
        moves, idle = tuple(moves), tuple(idle)
        for player, seq in [*((move.player, move.seq) for move in moves), *idle]:
            seat = self.seats[player]
            seat.seq = max(seat.seq, seq)
        for player, seq in idle:
            self.seats[player].answer = ActionAnswer(seq, self.step + 1)
        self._undone = lambda _: undone
        self._transition(moves, idle, tuple(waits), time)
        self._undone = nothing_undone
        self._events.clear()

    def replay_pause(self, time: float) -> None:
        """Time stood still from here on, or did already."""
        self._stopwatch.stop(time)

    def replay_resume(self, time: float) -> None:
        """Time ran again."""
        self._stopwatch.go_on(time)

    def ran(self, time: float) -> float:
        """The seconds for which the game had run, so many seconds after it began."""
        return self._stopwatch.read(time)

    def replay_moderation(self, what: Moderation, session: str, participant: str) -> None:
        """Apply a recorded decision of an operator."""
        self._apply_moderation(what, session, participant)

    def resume_after_restart(
        self,
        now: float,
        *,
        elapsed: float,
        patience: float,
        expected: Collection[str] = (),
        paused: bool = False,
    ) -> None:
        """Go on, once those who were present are back.

        Args:
            elapsed: Seconds since the start of the game.
            patience: Seconds for which is waited for everybody who was present…
            expected: … and for these players.
            paused: An operator had paused the game: it stays so.
        """
        begun = self.in_progress
        self._presence.used = self.used
        if begun:
            self._started = now - elapsed
        self._clock.start(now)
        self._emit(Restarted(elapsed))
        present = [seat for seat in self.seats.values() if seat.present]
        for seat in self.seats.values():
            seat.away = now
        for seat in present:
            seat.lose_connection(self._ran(now))
        for seat in present:
            self._emit_roster(seat, now)
        self.pauses.until.clear()
        if begun:
            awaited = {seat.player for seat in present} | set(expected)
            self._presence.expect(awaited, now + patience)
        if paused:
            self.pauses.until[PauseReason.OPERATOR] = None
        self._presence.watch(now, begun=begun)
        # The process may have stopped between the last step and the end.
        if begun and self._end_if_finished(now, goal=self.state.goal_reached):
            return
        self._update_pauses(now)

    def restore_ended(self, outcome: Outcome) -> None:
        """It had ended before the process stopped.

        Raises:
            IllegalEventError: It has ended here already.
        """
        self._enter_phase(PhaseEvent.END)
        self.outcome = outcome
        self.pauses.until.clear()
