"""What a report is made of: a row for each episode and each seat, read from the catalogue."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille_data.answers.selection import Selection
from robotouille_data.database import in_pieces
from robotouille_data.recordings.seat import ACTIVITIES
from robotouille_data.schema import EPISODES, EVENTS, LABELS, MEASURES, RECORDINGS, SEATS, STEPS

__all__ = ["Episode", "Facts", "Progress", "Seat", "read_facts"]

Progress = Callable[[str, int, int], None]
"""Is told what is done, how many of it are done, and how many there are."""
MAX_FAULTS = 20
"""Recordings that are named for which there is no episode."""
OWN_LABELS = ("pair", "round")


@dataclass(frozen=True, slots=True)
class Episode:
    """One episode. `group` is the value of the label that is compared, None without it; `path` is
    that of its recording."""

    id: int
    name: str
    task: str
    clock: str
    created: str
    state: str
    reason: str | None
    steps: int
    seconds: float
    success: bool | None
    optimality: float | None
    group: str | None
    pair: str | None
    round: str | None
    path: str | None

    @property
    def cluster(self) -> str:
        """What is alike: the pair's episodes, or of none the episode alone."""
        return f"pair {self.group}\0{self.pair}" if self.pair is not None else f"episode {self.id}"


@dataclass(frozen=True, slots=True)
class Seat:
    """One seat of an episode; `decision_ms` is the mean of its participant's applied actions, in
    which `delay_ms` is by which a study held them back."""

    episode: Episode
    number: int
    player: str
    kind: str
    did: tuple[int, ...]
    rejected: int
    lost: int
    said: int
    contribution: float
    decision_ms: float | None
    delay_ms: int

    def steps(self, activity: str) -> int:
        """The steps in which it did something."""
        return self.did[ACTIVITIES.index(activity)]

    @property
    def idle_share(self) -> float | None:
        """Idle steps of those in which its participant was in control; None if there are none."""
        present = sum(map(self.steps, ("acted", "busy", "waiting", "idle")))
        return self.steps("idle") / present if present else None


@dataclass(slots=True)
class Facts:
    """All of it. `interruptions` counts by episode and what happened: `absences` (of a seat's
    participant), `paused`, `restarted`. `faults` are the first of `damaged` recordings."""

    by: str
    episodes: list[Episode] = field(default_factory=list)
    seats: list[Seat] = field(default_factory=list)
    interruptions: dict[int, Counter[str]] = field(default_factory=dict)
    unknown: int = 0
    damaged: int = 0
    faults: list[tuple[str, str]] = field(default_factory=list)


def read_facts(connection: Connection, selection: Selection, by: str, progress: Progress) -> Facts:
    """The facts of some episodes.

    Args:
        by: The label that is compared.
    """
    facts, done = Facts(by, unknown=selection.left_out.get("unknown", 0)), 0
    broken = RECORDINGS.c.fault != ""
    facts.damaged = connection.scalar(
        sa.select(sa.func.count()).select_from(RECORDINGS).where(broken)
    ) or 0  # fmt: skip
    named = sa.select(RECORDINGS.c.path, RECORDINGS.c.fault).where(broken)
    facts.faults = [
        (path, fault)
        for path, fault in connection.execute(named.order_by(RECORDINGS.c.path).limit(MAX_FAULTS))
    ]
    for some in in_pieces(selection.ids):
        progress("episodes", done, len(selection.ids))
        episodes = {each.id: each for each in _episodes(connection, some, by)}
        facts.episodes += episodes.values()
        facts.seats += _seats(connection, some, episodes)
        _count_interruptions(connection, some, facts.interruptions)
        done += len(some)
    progress("episodes", done, len(selection.ids))
    return facts


def _episodes(connection: Connection, some: Sequence[int], by: str) -> Iterator[Episode]:
    labels = _labels(connection, some, {by, *OWN_LABELS})
    paths = _paths(connection, some)
    its, measured = EPISODES.c, MEASURES.c
    query = sa.select(
        its.id, its.episode, its.task, its.clock, its.created, its.state, its.reason, its.steps,
        its.seconds, measured.success, measured.optimality_rate,
    )  # fmt: skip
    joined = EPISODES.join(MEASURES, measured.episode_id == its.id)
    wanted = query.select_from(joined).where(its.id.in_(some)).order_by(its.id)
    for row in connection.execute(wanted):
        own = labels.get(row.id, {})
        yield Episode(
            *row, own.get(by), own.get("pair"), own.get("round"), paths.get(row.id)
        )  # fmt: skip


def _labels(
    connection: Connection, some: Sequence[int], names: set[str]
) -> dict[int, dict[str, str]]:
    its, found = LABELS.c, dict[int, dict[str, str]]()
    wanted = its.episode_id.in_(some) & its.name.in_(names)
    for number, name, value in connection.execute(
        sa.select(its.episode_id, its.name, its.value).where(wanted)
    ):
        found.setdefault(number, {})[name] = value
    return found


def _paths(connection: Connection, some: Sequence[int]) -> dict[int, str]:
    """The recording of each episode; of copies, the first by name."""
    its = RECORDINGS.c
    query = sa.select(its.episode_id, sa.func.min(its.path)).where(its.episode_id.in_(some))
    rows = connection.execute(query.group_by(its.episode_id))
    return {row[0]: row[1] for row in rows}


def _seats(
    connection: Connection, some: Sequence[int], episodes: dict[int, Episode]
) -> Iterator[Seat]:
    its = SEATS.c
    did = [its[name] for name in ACTIVITIES]
    query = sa.select(
        its.episode_id, its.seat, its.player, its.kind, its.rejected, its.lost, its.said,
        its.contribution, its.delay_ms, *did,
    )  # fmt: skip
    times = _decision_times(connection, some)
    wanted = query.where(its.episode_id.in_(some)).order_by(its.episode_id, its.seat)
    for (
        number,
        seat,
        player,
        kind,
        rejected,
        lost,
        said,
        work,
        delay,
        *counts,
    ) in connection.execute(wanted):
        time = times.get((number, seat))
        yield Seat(
            episodes[number],
            seat,
            player,
            kind,
            tuple(counts),
            rejected,
            lost,
            said,
            work,
            time,
            delay,
        )


def _decision_times(connection: Connection, some: Sequence[int]) -> dict[tuple[int, int], float]:
    its = STEPS.c
    query = sa.select(its.episode_id, its.seat, sa.func.sum(its.ms), sa.func.count(its.ms))
    wanted = query.where(its.episode_id.in_(some) & (its.activity == "acted"))
    rows: Any = connection.execute(wanted.group_by(its.episode_id, its.seat))
    return {(number, seat): int(total) / count for number, seat, total, count in rows if count}


def _count_interruptions(
    connection: Connection, some: Sequence[int], found: dict[int, Counter[str]]
) -> None:
    its, present = EVENTS.c, dict[tuple[int, int | None], bool]()
    wanted = its.episode_id.in_(some) & its.kind.in_(("roster", "paused", "restarted"))
    query = sa.select(its.episode_id, its.kind, its.seat, its.details).where(wanted)
    for number, kind, seat, details in connection.execute(
        query.order_by(its.episode_id, its.number)
    ):
        what = kind
        if kind == "roster":
            was, now = present.get((number, seat), False), bool(json.loads(details)["present"])
            present[number, seat] = now
            if now or not was:
                continue
            what = "absences"
        found.setdefault(number, Counter())[what] += 1
