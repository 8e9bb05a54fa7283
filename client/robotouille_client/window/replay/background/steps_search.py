"""Works out the steps to go of a history in a process of its own, and fills a curve with them."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from robotouille.certification.certificate import load_certificate
from robotouille.domain.loading import load_task
from robotouille.domain.task import Timing
from robotouille.errors import RobotouilleError
from robotouille_client.window.replay.background.line_process import LineProcess
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve, StepsKnown
from robotouille_client.window.replay.viewer_state import JobProgress, ViewerState

__all__ = ["StepsSearch"]

PROGRAM = "robotouille_client.window.replay.background.steps_worker"
EXPANSIONS = 500
SECONDS = 60.0
"""What a plan may cost, and after how long nothing more is worked out."""
GRACE = 5.0
"""Seconds after which a process that does not notice that is ended."""


class StepsSearch:
    """Begins on demand. A thread reads what the process finds: no frame waits for either.

    Args:
        path: The file that the process reads: a recording, or the states that were seen.
        now: A clock in seconds.
    """

    def __init__(
        self,
        path: Path,
        history: History,
        curve: StepsCurve,
        state: ViewerState,
        now: Callable[[], float],
    ) -> None:
        self._path = path
        self._history = history
        self._curve = curve
        self._state = state
        self._now = now
        self._began = 0.0
        self._told: set[int] = set()
        self._lines: deque[str] = deque()
        self._process: LineProcess | None = None
        self._ended = False

    @property
    def running(self) -> bool:
        """Whether something is being worked out."""
        return self._process is not None

    def start(self) -> None:
        """Begin; what is known without a search is there at once. Where all has been worked out,
        hide the curve or show it again."""
        if self._ended:
            self._curve.begun = not self._curve.begun
        if self.running or self._ended:
            return
        if not self._curve.begun:
            self._curve.begun = True
            self._tell_known()
        self._began = self._now()
        self._process = LineProcess(
            PROGRAM, str(self._path), str(EXPANSIONS), str(SECONDS), heard=self._lines.append
        )
        self._show()

    def _tell_known(self) -> None:
        """What the task's certificate says of the beginning, and the outcome of the end."""
        history = self._history
        known = _certified(history)
        if known is not None and history.first == 0:
            self._curve.add(0, known)
        if history.state(history.length).goal_reached:
            self._curve.add(history.length, StepsKnown(0, 0))

    def wait(self, seconds: float) -> bool:
        """Whether it has ended, after so many seconds at most."""
        return self._process is None or self._process.ended(seconds)

    def poll(self) -> None:
        """Take over what was found since the last time."""
        process = self._process
        if process is None:
            return
        ended = process.ended()
        while self._lines:
            step, least, most, dead = json.loads(self._lines.popleft())
            self._told.add(step)
            self._curve.add(step, StepsKnown(least, most, dead))
        late = self._now() - self._began > SECONDS + GRACE
        if ended:
            self._end(process.fault)
        elif late:
            self.stop()
        else:
            self._show()

    @property
    def _whole(self) -> int:
        """How many states there are."""
        return self._history.length - self._history.first + 1

    def _show(self) -> None:
        """How much is known, and how much of the time has passed, whichever is more."""
        known, whole = len(self._told), self._whole
        seconds = self._now() - self._began
        left = max(0, round(SECONDS - seconds))
        words = f"Steps to go: {known} of {whole}, for {left} s more at most"
        if known == whole:
            words = f"Steps to go: what is proven, for {left} s more at most"
        done = seconds / SECONDS if known == whole else max(known / whole, seconds / SECONDS)
        self._state.jobs[f"steps {self._path}"] = JobProgress(words, self.stop, done)

    def _end(self, fault: str) -> None:
        self._forget()
        if fault:
            self._state.tell(f"Steps to go: {fault}")
            return
        self._ended = True
        self._tell_end()

    def _tell_end(self) -> None:
        known, whole = len(self._told), self._whole
        if known == whole:
            self._state.tell("The steps to go are known at every step")
        else:
            self._state.tell(
                f"The steps to go are known at {known} of {whole} steps, straight lines between"
            )

    def stop(self) -> None:
        """Be content with what is known."""
        self.close()
        self._forget()
        self._tell_end()

    def _forget(self) -> None:
        self._process = None
        self._state.jobs.pop(f"steps {self._path}", None)

    def close(self) -> None:
        """Stop working."""
        if self._process is not None:
            self._process.stop()


def _certified(history: History) -> StepsKnown | None:
    """What the certificate of a shipped task says of its beginning, if there is one."""
    task = replace(history.world.task, timing=Timing.BENCHMARK)
    try:
        shipped = load_task(task.name, seats=task.seats)
        if shipped.digest != task.digest:
            return None
        certificate = load_certificate(shipped)
    except (RobotouilleError, OSError):
        return None
    return StepsKnown(certificate.bound, certificate.length)
