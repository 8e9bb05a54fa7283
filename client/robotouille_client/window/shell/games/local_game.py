"""A game in this process: its world, its partners, and its recording."""

from __future__ import annotations

import contextlib
import re
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from robotouille.certification.step_limit import people_step_limit
from robotouille.domain.loading import load_task
from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.domain.task import Task
from robotouille.episode import Episode, Event, Rules
from robotouille.episode.rules import Clock
from robotouille.errors import RecordingError
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille.replay.container import compress
from robotouille.replay.recorder import Recorder, header
from robotouille.world.lint import sound_task
from robotouille.world.world import World
from robotouille_client.bots.kinds import BotKind
from robotouille_client.bots.names import given_names
from robotouille_client.bots.partner_process import PartnerProcess
from robotouille_client.bots.partners import MakePartners, Partners, PromptPartners
from robotouille_client.window.sources.local import LocalSource

__all__ = ["NO_CERTIFICATE", "GameSetup", "LocalGame", "recordings_folder", "step_limit"]

KEPT_RECORDINGS = 50
NO_CERTIFICATE = 1000
"""Steps for a task of which no shortest plan is known."""


@dataclass(frozen=True, slots=True)
class GameSetup:
    """What is to be played here: a task with its seats, the clock, the partners, the step limit
    (None: six times the shortest plan, three minutes at least), the seed of all that is random, and
    the seconds that are counted down before it begins in real time."""

    task: str
    seats: int | None = None
    clock: Clock = Clock.REALTIME
    rate: float = 5.0
    partner: BotKind = BotKind.PLANNER
    timing: str | None = None
    max_steps: int | None = None
    seed: int = 0
    countdown: float = 3.0

    @property
    def profile(self) -> str:
        """The timing: people's in real time, unless something else is asked for."""
        return self.timing or ("people" if self.clock is Clock.REALTIME else "benchmark")

    def load(self) -> Task:
        """Its task; RobotouilleError as `load_task` raises it."""
        return load_task(self.task, seats=self.seats, timing=self.profile, seed=self.seed)


def recordings_folder() -> Path:
    """Where the games that were played here are kept."""
    from platformdirs import user_data_path

    return user_data_path("robotouille") / "recordings"


class LocalGame:
    """An episode, its bots, its source for the window, and its file, if a `folder` is given.

    `finish` ends what was begun.
    """

    def __init__(
        self,
        setup: GameSetup,
        name: str,
        now: Callable[[], float],
        folder: Path | None,
        make_partners: MakePartners = PartnerProcess,
        words: Language = NO_WORDS,
    ) -> None:
        task = sound_task(setup.load())
        self.world = World(task)
        rules = _rules(setup, task)
        me = seat_out_of_the_way(self.world.initial)
        others = [player for player in self.world.players if player != me]
        names = [n for n in given_names(setup.seed) if n.casefold() != name.casefold()]
        self._partners: Partners = PromptPartners({})
        if others:
            self._partners = make_partners(
                self.world.initial, setup.partner, setup.seed, others, words
            )
        self.path: Path | None = None
        self._recorder = Recorder(self.world)
        if folder is not None:
            self._begin(folder, rules, setup.seed)
        episode = Episode(self.world, rules, now())
        self.source = LocalSource(
            episode,
            me,
            dict(zip(others, names, strict=False)),
            self._partners,
            now,
            name=name,
            record=self._record,
            words=words,
        )

    def finish(self, *, over: bool) -> Path | None:
        """Let the bots go and close the recording; its file, or None where there is none.

        One of a game that is not over is forgotten.
        """
        self._partners.close()
        if not over:
            self._discard()
            return None
        path = self.path
        if path is None or path.suffix != ".part":
            return path
        whole = path.with_suffix("")
        try:
            whole.write_bytes(compress(path.read_bytes()))
            path.unlink()
        except OSError:
            return None
        self.path = whole
        return whole

    def _discard(self) -> None:
        if self.path is not None:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)

    def _begin(self, folder: Path, rules: Rules, seed: int) -> None:
        created = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        episode = secrets.token_hex(4)
        words = re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{created}_{self.world.task.name}_{episode}")
        head = header(self.world.task, rules, episode=episode, seed=seed, created=created)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _forget_old(folder)
            self.path = folder / f"{words}.rbt.part"
            self.path.write_bytes(self._recorder.begin(head))
        except (OSError, RecordingError):
            self.path = None

    def _record(self, events: Iterable[Event]) -> None:
        """Append events; a disk that is full ends the recording, not the game."""
        if self.path is None:
            return
        try:
            with self.path.open("ab") as file:
                file.write(self._recorder.record(events))
        except (OSError, RecordingError):
            self._discard()
            self.path = None


def step_limit(task: Task, clock: Clock, rate: float) -> int:
    """The steps that somebody gets for a task."""
    limit = people_step_limit(task, rate if clock is Clock.REALTIME else None)
    return limit or NO_CERTIFICATE


def _rules(setup: GameSetup, task: Task) -> Rules:
    return Rules(
        clock=setup.clock,
        step_rate=setup.rate,
        max_steps=setup.max_steps or step_limit(task, setup.clock, setup.rate),
        countdown=setup.countdown if setup.clock is Clock.REALTIME else 0.0,
    )


def _forget_old(folder: Path) -> None:
    """Make room for one more recording."""
    kept = sorted(folder.glob("*.rbt*"), key=lambda path: path.name)
    for path in kept[: max(0, len(kept) - KEPT_RECORDINGS + 1)]:
        path.unlink(missing_ok=True)
