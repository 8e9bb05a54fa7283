"""One game in this process: its world, its bots and its recording."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from robotouille.certification.step_limit import people_step_limit
from robotouille.domain.loading import load_task
from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.domain.task import Task
from robotouille.episode import Episode, EpisodeEnded, Event, Rules
from robotouille.episode.rules import Clock
from robotouille.errors import RecordingError
from robotouille.files.writing import replace_file
from robotouille.planning.policies.standing import seat_out_of_the_way
from robotouille.replay.compression import compress
from robotouille.replay.file_names import CLOSED, file_name
from robotouille.replay.recorder import Recorder, header
from robotouille.world.lint import sound_task
from robotouille.world.world import World
from robotouille_client.bots.kinds import BotSetup, given_names
from robotouille_client.bots.partners import MakePartners, PartnerProcess, Partners, PromptPartners
from robotouille_client.window.sources.local import LocalSeats, LocalSource

COMPANION = "companion"
"""Name of the second person at a window."""
KEPT_RECORDINGS = 50
NO_CERTIFICATE = 1000
"""Step limit of tasks without a known plan."""


@dataclass(frozen=True, slots=True)
class GameSetup:
    """Options of a local game.

    Attributes:
        partner: Kind of the bots, or a skill of planners.
        timing: Timing profile; None for `people` in real time and else `benchmark`.
        max_steps: Step limit; None for six times the shortest plan, but at least three minutes.
        countdown: Seconds before a real-time game starts.
        seed: Seed of a shift's orders and of the bots.
        people: People at this window, 1 or 2; the other seats have bots.
    """

    task: str
    seats: int | None = None
    clock: Clock = Clock.REALTIME
    rate: float = 5.0
    partner: str = "partner"
    timing: str | None = None
    max_steps: int | None = None
    seed: int = 0
    countdown: float = 3.0
    people: int = 1

    @property
    def profile(self) -> str:
        return self.timing or ("people" if self.clock is Clock.REALTIME else "benchmark")

    def load(self) -> Task:
        """Load the task; raise RobotouilleError as `load_task` does."""
        return load_task(self.task, seats=self.seats, timing=self.profile, seed=self.seed)


def recordings_folder() -> Path:
    """Return the folder for recordings of local games."""
    from platformdirs import user_data_path

    return user_data_path("robotouille") / "recordings"


class LocalGame:
    """Local episode with its bots, source and recording. Call `finish` at the end.

    `people` are the players at this window.

    Args:
        folder: Folder for the recording; None to keep none.
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
        self.step_seconds = rules.period if rules.scheduled else None
        # A person who only watches at first must not block the bots.
        me = seat_out_of_the_way(self.world.initial)
        others = [player for player in self.world.players if player != me]
        companion = others.pop(0) if setup.people > 1 and others else ""
        self.people = (me, companion) if companion else (me,)
        companion_name = COMPANION if name.casefold() != COMPANION else f"{COMPANION} 2"
        # Equal names could not be distinguished in the chat.
        names = [n for n in given_names() if n.casefold() != name.casefold()]
        bots = BotSetup.named(setup.partner, setup.seed, words)
        self._partners: Partners = PromptPartners({})
        # `PartnerProcess` starts a process, which a game for one player does not need.
        if others:
            step_seconds = 1 / setup.rate if setup.clock is Clock.REALTIME else 0.0
            self._partners = make_partners(self.world.initial, bots, others, step_seconds)
        self.path: Path | None = None
        self._recorder = Recorder(self.world)
        if folder is not None:
            self._begin_recording(folder, rules, setup.seed)
        episode = Episode(self.world, rules, now())
        self.source = LocalSource(
            episode,
            LocalSeats(
                me,
                dict(zip(others, names, strict=False)),
                name,
                bots.agent,
                (companion, companion_name),
            ),
            self._partners,
            now,
            record=self._record,
            words=words,
        )

    def finish(self, *, ended: bool) -> Path | None:
        """Stop the bots and close the recording; return its file, or None if there is none.

        The recording of a game that has not ended is deleted.
        """
        self._partners.close()
        if not ended:
            self._discard()
            return None
        self._close_recording()
        closed = self.path is not None and self.path.suffix == CLOSED
        return self.path if closed else None

    def _close_recording(self) -> None:
        """Turn the recording of an ended game into a closed one, if it is not closed already."""
        path = self.path
        if path is None or path.suffix == CLOSED:
            return
        whole = path.with_suffix("")
        try:
            # Compressing at the end allows appending frames as they come during the game. A window
            # that is killed in between leaves the open recording.
            replace_file(whole, compress(path.read_bytes()))
            path.unlink()
        except OSError:
            return
        self.path = whole

    def _discard(self) -> None:
        if self.path is not None:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)

    def _begin_recording(self, folder: Path, rules: Rules, seed: int) -> None:
        created = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        episode = secrets.token_hex(4)
        head = header(self.world.task, rules, episode=episode, seed=seed, created=created)
        try:
            # A game without a recording is better than no game.
            folder.mkdir(parents=True, exist_ok=True)
            _delete_old(folder)
            self.path = folder / file_name(created, self.world.task.name, episode)
            self.path.write_bytes(self._recorder.begin(head))
        except (OSError, RecordingError):
            self.path = None

    def _record(self, events: Iterable[Event]) -> None:
        """Append events. If the disk is full, the recording ends but the game continues."""
        if self.path is None:
            return
        try:
            with self.path.open("ab") as file:
                file.write(self._recorder.record(recorded := list(events)))
        except (OSError, RecordingError):
            self._discard()
            self.path = None
            return
        # The card at the end may stay for hours, and the window may be killed while it does.
        if any(isinstance(event, EpisodeEnded) for event in recorded):
            self._close_recording()


def step_limit(task: Task, clock: Clock, rate: float) -> int:
    limit = people_step_limit(task, rate if clock is Clock.REALTIME else None)
    return limit or NO_CERTIFICATE


def _rules(setup: GameSetup, task: Task) -> Rules:
    return Rules(
        clock=setup.clock,
        step_rate=setup.rate,
        max_steps=setup.max_steps or step_limit(task, setup.clock, setup.rate),
        countdown=setup.countdown if setup.clock is Clock.REALTIME else 0.0,
    )


def _delete_old(folder: Path) -> None:
    """Delete the oldest recordings to make room for one more."""
    # File names begin with the time of the game, so the oldest games come first.
    kept = sorted(folder.glob("*.rbt*"), key=lambda path: path.name)
    for path in kept[: max(0, len(kept) - KEPT_RECORDINGS + 1)]:
        path.unlink(missing_ok=True)
