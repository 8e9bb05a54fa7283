"""The matrix of a population: episodes of all pairs, their means and intervals."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import product

from robotouille.domain.task import Task
from robotouille.html_report.intervals import Interval, wilson_interval
from robotouille.planning.policies.lockstep import play_in_lockstep
from robotouille.world.world import State, World
from robotouille_evaluation.cross_play.partners import Partner
from robotouille_evaluation.metrics.statistics import bootstrap


@dataclass(frozen=True)
class CrossEpisode:
    """One episode of a pair.

    Attributes:
        first: The partner in the first seat.
        other: The partner in all other seats.
        goal: True if the goal was reached; always false in shifts.
        score: Points of a shift, else 1 if the goal was reached.
    """

    first: str
    other: str
    seed: int
    goal: bool
    steps: int
    score: float


@dataclass(frozen=True)
class Measure:
    """A column of the tables: a value of each episode, and how to estimate and write its mean.

    Attributes:
        share: True if the values are 0 and 1. Tables show such means in per cent.
    """

    name: str
    value: Callable[[CrossEpisode], float]
    share: bool = False

    @property
    def heading(self) -> str:
        """Name in tables for people, with the unit."""
        return f"{self.name} (%)" if self.share else self.name

    def estimate(self, episodes: Iterable[CrossEpisode]) -> Interval | None:
        """Return the mean with its 95 % interval: Wilson's for shares, else the bootstrap's."""
        values = [self.value(episode) for episode in episodes]
        if self.share:
            return wilson_interval(int(sum(values)), len(values))
        return bootstrap([[value] for value in values], binary=False)

    def text(self, interval: Interval | None) -> str:
        """Return a mean in words."""
        if interval is None:
            return "-"
        return interval.text(self._number, self._number)

    def _number(self, value: float) -> str:
        return f"{100 * value:.0f}" if self.share else f"{value:.1f}"


GOAL = Measure("success", lambda episode: episode.goal, share=True)
STEPS = Measure("steps", lambda episode: episode.steps)
SCORE = Measure("points", lambda episode: episode.score)


def measures_of(task: Task) -> tuple[Measure, ...]:
    """Return the measures of a task: points in a shift, else success and steps."""
    return (GOAL, STEPS) if task.problem.shift is None else (SCORE,)


def play_pairs(
    task: Task,
    partners: Sequence[Partner],
    episodes: int,
    seed: int,
    max_steps: int,
    watch: Callable[[Sequence[CrossEpisode]], None] = lambda played: None,
) -> list[CrossEpisode]:
    """Play all ordered pairs, also each partner with itself.

    A pair's episodes depend on its two partners and the seed only, not on the others.

    Args:
        watch: Function that is called with the episodes of each pair.
    """
    played = []
    for first, other in product(partners, repeat=2):
        start = _seed(seed, first.name, other.name)
        own = _play(World(task), (first, other), range(start, start + episodes), max_steps)
        played += own
        watch(own)
    return played


def _seed(seed: int, first: str, other: str) -> int:
    text = json.dumps([seed, first, other])
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest())


def _play(
    world: World, partners: tuple[Partner, Partner], seeds: Sequence[int], max_steps: int
) -> list[CrossEpisode]:
    first, other = partners
    makers = first.maker(seeds[0]), other.maker(seeds[0])
    found = []
    for seed in seeds:
        # The seats draw different numbers: otherwise two copies of a policy make the same slips.
        policies = {
            player: makers[seat > 0](world.initial, player, seed * len(world.players) + seat)
            for seat, player in enumerate(world.players)
        }
        plan, last = play_in_lockstep(world.initial, policies, max_steps)
        goal, steps = last.goal_reached, len(plan)
        found.append(CrossEpisode(first.name, other.name, seed, goal, steps, _score(last)))
    return found


def _score(state: State) -> float:
    return float(state.goal_reached if state.orders is None else state.orders.score)


def pair(episodes: Iterable[CrossEpisode], first: str, other: str) -> list[CrossEpisode]:
    """Return a pair's episodes."""
    return [e for e in episodes if (e.first, e.other) == (first, other)]


def text_table(episodes: Sequence[CrossEpisode], names: Sequence[str], measure: Measure) -> str:
    """Return a measure of all pairs as a table, and its means with themselves and with others."""
    rows = [
        [first, *(measure.text(measure.estimate(pair(episodes, first, other))) for other in names)]
        for first in names
    ]
    head = [measure.heading, *names]
    widths = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
    lines = []
    for name, *cells in (head, *rows):
        aligned = [cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True)]
        lines.append("  ".join([name.ljust(widths[0]), *aligned]))
    own = measure.estimate(e for e in episodes if e.first == e.other)
    others = measure.estimate(e for e in episodes if e.first != e.other)
    lines.append(f"with itself: {measure.text(own)}; with others: {measure.text(others)}")
    return "\n".join(lines)


FIELDS = ("first", "other", "measure", "mean", "low", "high", "episodes")


def csv_text(
    episodes: Sequence[CrossEpisode], names: Sequence[str], measures: Sequence[Measure]
) -> str:
    """Return the means of all pairs as CSV."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(FIELDS)
    for first in names:
        for other in names:
            for measure in measures:
                found = measure.estimate(pair(episodes, first, other))
                if found is not None:
                    numbers = (found.estimate, found.low, found.high, found.count)
                    writer.writerow((first, other, measure.name, *numbers))
    return file.getvalue()


def json_text(episodes: Sequence[CrossEpisode], task: Task, seed: int) -> str:
    """Return all episodes as JSON."""
    found = {"task": task.name, "digest": task.digest, "seed": seed}
    return json.dumps({**found, "episodes": [asdict(e) for e in episodes]}, indent=1) + "\n"
