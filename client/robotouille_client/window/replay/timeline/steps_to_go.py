"""Steps to go: a curve below the kitchen, and the background job that computes it."""

from __future__ import annotations

import json
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pygame

from robotouille.certification.certificate import load_certificate
from robotouille.domain.loading import load_task
from robotouille.domain.task import Timing
from robotouille.errors import RobotouilleError
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BAD, CARD, FAINT, INK, mixed
from robotouille_client.window.replay.background import WORKERS, LineProcess
from robotouille_client.window.replay.histories.history import History
from robotouille_client.window.replay.timeline.lanes import Scale
from robotouille_client.window.replay.viewer_state import JobProgress, ViewerState


class StepsKnown(NamedTuple):
    """Bounds on the fewest steps from a state to the goal.

    `most` is None if no plan is known. In a `dead` state the goal is out of reach.
    """

    least: int
    most: int | None
    dead: bool = False

    @property
    def words(self) -> str:
        """The bounds in words, such as `12 steps to go` or `at least 12 steps to go`."""
        if self.dead:
            return "the goal is out of reach"
        if self.most is None:
            return f"at least {self.least} steps to go"
        if self.most == self.least:
            return f"{self.least} steps to go"
        if self.least <= 1:
            return f"{self.most} steps to go, or fewer"
        return f"{self.least} to {self.most} steps to go"

    def joined(self, other: StepsKnown) -> StepsKnown:
        """Return the tighter bounds of two."""
        if self.dead or other.dead:
            return self if self.dead else other
        most = min((m for m in (self.most, other.most) if m is not None), default=None)
        return StepsKnown(max(self.least, other.least), most)


class StepsCurve:
    """Curve that becomes finer as more steps are known; straight, fainter lines fill the gaps.

    `begun` says that the curve has room in the strip.
    """

    def __init__(self) -> None:
        self.begun = False
        self.known: dict[int, StepsKnown] = {}
        self._steps: list[int] = []
        self._changes = 0
        self._surface: pygame.Surface | None = None
        self._drawn: tuple[object, ...] = ()

    def add(self, step: int, known: StepsKnown) -> None:
        """Add what is known about a step."""
        before = self.known.get(step)
        if before is None:
            insort(self._steps, step)
        self.known[step] = known if before is None else before.joined(known)
        self._changes += 1

    def redraw_key(self) -> object:
        """Return a value that changes whenever the picture would."""
        return self.begun, self._changes

    def words(self, step: int) -> str:
        """Return what is known about a step in words, or an empty string."""
        if step in self.known:
            return self.known[step].words
        height = self._between(step)
        return "" if height is None else f"about {round(height[1])} steps to go"

    @property
    def highest(self) -> int:
        """Most steps to go on the curve."""
        return max((k.most or k.least for k in self.known.values() if not k.dead), default=1) or 1

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, scale: Scale
    ) -> None:
        """Draw the curve over the visible steps, its highest point at the top."""
        if not self.begun:
            return
        inside = area.inflate(0, -size // 2)
        drawn = (inside.size, scale.first, scale.shown, self._changes)
        if self._surface is None or drawn != self._drawn:
            self._surface, self._drawn = pygame.Surface(inside.size), drawn
            self._surface.fill(mixed(CARD, INK, 0.25))
            self._columns(self._surface, scale)
        target.blit(self._surface, inside)
        small = max(9, size - 4)
        for words, y in ((str(self.highest), inside.top), ("0", inside.bottom - small)):
            number = text.line(words, small, FAINT)
            target.blit(number, number.get_rect(topright=(area.left - 4, y)))
        label = text.line(text.fit("steps to go", small, max(1, area.left - 8)), small, FAINT)
        target.blit(label, label.get_rect(midright=(area.left - 4, inside.centery)))

    def _columns(self, surface: pygame.Surface, scale: Scale) -> None:
        """Draw one column of pixels for each step, or for one of several steps."""
        (width, height), highest = surface.get_size(), self.highest
        before: int | None = None
        for x in range(width):
            step = int(scale.first + x * scale.shown / width + 0.5)
            known = self.known.get(step)
            if known is not None and known.dead:
                surface.fill(mixed(BAD, INK, 0.35), (x, 0, 1, height))
                before = None
                continue
            ends = self._ends(known) if known is not None else self._between(step)
            if ends is None:
                before = None
                continue
            low, high = (height - round(min(end / highest, 1.0) * height) for end in ends)
            surface.fill(mixed(ACCENT, CARD, 0.75), (x, low, 1, height - low))
            surface.fill(mixed(ACCENT, CARD, 0.5), (x, high, 1, low - high))
            top, bottom = sorted((high, high if before is None else before))
            sure = known is not None and known.most is not None
            colour = ACCENT if sure else mixed(ACCENT, CARD, 0.35)
            surface.fill(colour, (x, min(top, height - 2), 1, max(2, bottom - top)))
            before = high

    @staticmethod
    def _ends(known: StepsKnown) -> tuple[float, float]:
        """Return the height of the proven part, and of the curve."""
        return known.least, known.least if known.most is None else known.most

    def _between(self, step: int) -> tuple[float, float] | None:
        """Return the same heights for a step between two known ones."""
        place = bisect_left(self._steps, step)
        if not 0 < place < len(self._steps):
            return None
        left, right = self._steps[place - 1], self._steps[place]
        one, other = self.known[left], self.known[right]
        if one.dead or other.dead:
            return None
        share = (step - left) / (right - left)
        low, high = (
            a + (b - a) * share for a, b in zip(self._ends(one), self._ends(other), strict=True)
        )
        return low, high


# Search budget of one plan.
EXPANSIONS = 500
# Time after which the search stops.
SECONDS = 60.0
# Seconds after which a process that has not stopped by itself is killed.
GRACE = 5.0


class StepsSearch:
    """Job that searches for the steps to go in a process. No frame waits for it.

    Args:
        path: File for the process: a recording, or saved states.
        now: Clock in seconds.
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
        self._found: set[int] = set()
        self._lines: deque[str] = deque()
        self._process: LineProcess | None = None
        self._ended = False

    @property
    def running(self) -> bool:
        """True while the search runs."""
        return self._process is not None

    def start(self) -> None:
        """Start the search, or show or hide the curve if the search is complete.

        The certificate's bounds appear at once.
        """
        if self._ended:
            self._curve.begun = not self._curve.begun
        if self.running or self._ended:
            return
        if not self._curve.begun:
            self._curve.begun = True
            self._add_known()
        self._began = self._now()
        self._process = LineProcess(
            WORKERS,
            "steps",
            str(self._path),
            str(EXPANSIONS),
            str(SECONDS),
            on_line=self._lines.append,
        )
        self._show()

    def _add_known(self) -> None:
        """Add the certificate's bounds for the beginning, and the end if the goal was reached."""
        history = self._history
        known = _certified(history)
        # A spectator who came later has not seen the initial state.
        if known is not None and history.first == 0:
            self._curve.add(0, known)
        if history.state(history.length).goal_reached:
            self._curve.add(history.length, StepsKnown(0, 0))

    def wait(self, seconds: float) -> bool:
        """Wait for some seconds. Return whether the search has ended."""
        return self._process is None or self._process.ended(seconds)

    def poll(self) -> None:
        """Take over new findings and report progress."""
        process = self._process
        if process is None:
            return
        ended = process.ended()
        while self._lines:
            step, least, most, dead = json.loads(self._lines.popleft())
            self._found.add(step)
            self._curve.add(step, StepsKnown(least, most, dead))
        # The process may notice its own deadline late.
        late = self._now() - self._began > SECONDS + GRACE
        if ended:
            self._end(process.fault)
        elif late:
            self.stop()
        else:
            self._show()

    @property
    def _whole(self) -> int:
        return self._history.length - self._history.first + 1

    def _show(self) -> None:
        """Report how much is known, or how much of the time has passed, whichever is more."""
        known, whole = len(self._found), self._whole
        seconds = self._now() - self._began
        left = max(0, round(SECONDS - seconds))
        words = f"Steps to go: {known} of {whole}, up to {left} s more"
        if known == whole:
            words = f"Steps to go: proving bounds, up to {left} s more"
        done = seconds / SECONDS if known == whole else max(known / whole, seconds / SECONDS)
        self._state.jobs[f"steps {self._path}"] = JobProgress(words, self.stop, done)

    def _end(self, fault: str) -> None:
        self._forget()
        if fault:
            self._state.show_message(f"Steps to go: {fault}")
            return
        self._ended = True
        self._report_end()

    def _report_end(self) -> None:
        known, whole = len(self._found), self._whole
        if known == whole:
            self._state.show_message("Steps to go: known for every step")
        else:
            self._state.show_message(
                f"Steps to go: known for {known} of {whole} steps, with straight lines between"
            )

    def stop(self) -> None:
        """Stop; keep what is known."""
        self.close()
        self._forget()
        self._report_end()

    def _forget(self) -> None:
        self._process = None
        self._state.jobs.pop(f"steps {self._path}", None)

    def close(self) -> None:
        """Stop without a report."""
        if self._process is not None:
            self._process.stop()


def _certified(history: History) -> StepsKnown | None:
    """Return the bounds in the certificate of a shipped task, or None."""
    task = replace(history.world.task, timing=Timing.BENCHMARK)
    try:
        shipped = load_task(task.name, seats=task.seats)
        if shipped.digest != task.digest:
            return None
        certificate = load_certificate(shipped)
    except (RobotouilleError, OSError):
        return None
    return StepsKnown(certificate.bound, certificate.length)
