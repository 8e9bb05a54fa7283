"""Facts of a report: a row for each episode and each seat, and groups of episodes by a label."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille.html_report.figures import short_label
from robotouille_data.database import in_pieces
from robotouille_data.query import Selection
from robotouille_data.recorded_seats import ACTIVITIES, INACTIVE
from robotouille_data.schema import EPISODES, EVENTS, LABELS, MEASURES, RECORDINGS, SEATS, STEPS

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, the number of finished items and their total."""
MAX_FAULTS = 3
"""Damaged recordings that a page names. It has the number of all."""
OWN_LABELS = ("pair", "round")
MAX_GROUPS = 8
"""Groups that are compared: there are eight distinct colours."""
MAX_PLAYERS = 4
"""Players of a task that are shown separately."""
KINDS = {"human": "people", "bot": "bots", "model": "models", "": "nobody"}


class ShiftScore(NamedTuple):
    """Score of a finished shift. `bound` are the points that nobody can exceed."""

    points: int
    served: int
    expired: int
    bound: int | None

    @property
    def share(self) -> float | None:
        """Share of the points that nobody can exceed; None if they are unknown or 0."""
        return self.points / self.bound if self.bound else None


@dataclass(frozen=True, slots=True)
class EpisodeFacts:
    """One episode.

    Attributes:
        score: Score of a finished shift; None for other episodes.
        group: Value of the label that is compared, or None without the label.
        path: Path of the recording.
    """

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
    score: ShiftScore | None
    group: str | None
    pair: str | None
    round: str | None
    path: str | None

    @property
    def cluster(self) -> str:
        """Cluster for the bootstrap: the pair, or the episode alone if it has no pair."""
        return f"pair {self.group}\0{self.pair}" if self.pair is not None else f"episode {self.id}"


@dataclass(frozen=True, slots=True)
class SeatFacts:
    """One seat of an episode.

    Attributes:
        activities: Number of steps for each of `ACTIVITIES`.
        unused: Inactive steps in which the seat could act usefully; None if not computed.
        decision_ms: Mean decision time of the participant's applied actions.
        delay_ms: Delay that a study added to each action. It is part of `decision_ms`.
    """

    episode: EpisodeFacts
    number: int
    player: str
    kind: str
    activities: tuple[int, ...]
    rejected: int
    lost: int
    said: int
    decision_ms: float | None
    delay_ms: int
    unused: int | None

    def steps(self, activity: str) -> int:
        """Return the number of steps with an activity."""
        return self.activities[ACTIVITIES.index(activity)]

    @property
    def inactive_share(self) -> float | None:
        """Share of inactive steps among the steps in which the participant had control.

        It includes steps in which a bot declared a wait, because people cannot declare one.
        """
        return self._share(sum(map(self.steps, INACTIVE)))

    @property
    def unused_share(self) -> float | None:
        """Share of the steps in which the participant could act usefully and did not."""
        return None if self.unused is None else self._share(self.unused)

    def _share(self, steps: int) -> float | None:
        present = sum(map(self.steps, ("acted", "busy", *INACTIVE)))
        return steps / present if present else None


@dataclass(slots=True)
class Facts:
    """All facts of a report.

    Attributes:
        by: Name of the label that is compared.
        interruptions: For each episode, counts of `absences`, `paused` and `restarted`.
        unknown: Number of episodes that the query names and the catalogue lacks.
        faults: Paths and faults of the first of the `damaged` recordings.
    """

    by: str
    episodes: list[EpisodeFacts] = field(default_factory=list)
    seats: list[SeatFacts] = field(default_factory=list)
    interruptions: dict[int, Counter[str]] = field(default_factory=dict)
    unknown: int = 0
    damaged: int = 0
    faults: list[tuple[str, str]] = field(default_factory=list)


def read_facts(connection: Connection, selection: Selection, by: str, progress: Progress) -> Facts:
    """Read the facts of the selected episodes. `by` is the label that is compared."""
    facts, done = Facts(by, unknown=selection.left_out.get("unknown", 0)), 0
    broken = RECORDINGS.c.fault != ""
    count = sa.select(sa.func.count()).select_from(RECORDINGS).where(broken)
    facts.damaged = connection.scalar(count) or 0
    first = sa.select(RECORDINGS.c.path, RECORDINGS.c.fault).where(broken)
    rows = connection.execute(first.order_by(RECORDINGS.c.path).limit(MAX_FAULTS))
    facts.faults = [(path, fault) for path, fault in rows]
    for some in in_pieces(selection.ids):
        progress("episodes", done, len(selection.ids))
        episodes = {each.id: each for each in _episodes(connection, some, by)}
        facts.episodes += episodes.values()
        facts.seats += _seats(connection, some, episodes)
        _count_interruptions(connection, some, facts.interruptions)
        done += len(some)
    progress("episodes", done, len(selection.ids))
    return facts


def _episodes(connection: Connection, ids: Sequence[int], by: str) -> Iterator[EpisodeFacts]:
    labels = _labels(connection, ids, {by, *OWN_LABELS})
    # Copies of a recording are one episode. The path that comes first is as good as any other.
    paths: dict[int, str] = {
        row[0]: row[1]
        for row in connection.execute(
            sa.select(RECORDINGS.c.episode_id, sa.func.min(RECORDINGS.c.path))
            .where(RECORDINGS.c.episode_id.in_(ids))
            .group_by(RECORDINGS.c.episode_id)
        )
    }
    its, measured = EPISODES.c, MEASURES.c
    query = sa.select(
        its.id, its.episode, its.task, its.clock, its.created, its.state, its.reason, its.steps,
        its.seconds, measured.success, measured.optimality_rate, measured.score, measured.served,
        measured.expired, measured.score_bound,
    )  # fmt: skip
    joined = EPISODES.join(MEASURES, measured.episode_id == its.id)
    wanted = query.select_from(joined).where(its.id.in_(ids)).order_by(its.id)
    rows: Any = connection.execute(wanted)
    for row in rows:
        score = None if row.score is None else ShiftScore(*row[-len(ShiftScore._fields) :])
        own = labels.get(row.id, {})
        names = (own.get(by), own.get("pair"), own.get("round"))
        known = (*row[: -len(ShiftScore._fields)], score, *names, paths.get(row.id))
        yield EpisodeFacts(*known)


def _labels(
    connection: Connection, ids: Sequence[int], names: set[str]
) -> dict[int, dict[str, str]]:
    its, found = LABELS.c, dict[int, dict[str, str]]()
    wanted = its.episode_id.in_(ids) & its.name.in_(names)
    query = sa.select(its.episode_id, its.name, its.value).where(wanted)
    for number, name, value in connection.execute(query):
        found.setdefault(number, {})[name] = value
    return found


def _seats(
    connection: Connection, ids: Sequence[int], episodes: dict[int, EpisodeFacts]
) -> Iterator[SeatFacts]:
    its = SEATS.c
    query = sa.select(
        its.episode_id, its.seat, its.player, its.kind, its.rejected, its.lost, its.said,
        its.delay_ms, its.unused, *(its[name] for name in ACTIVITIES),
    )  # fmt: skip
    times = _decision_times(connection, ids)
    wanted = query.where(its.episode_id.in_(ids)).order_by(its.episode_id, its.seat)
    for row in connection.execute(wanted):
        yield SeatFacts(
            episode=episodes[row.episode_id],
            number=row.seat,
            player=row.player,
            kind=row.kind,
            activities=tuple(row[-len(ACTIVITIES) :]),
            rejected=row.rejected,
            lost=row.lost,
            said=row.said,
            decision_ms=times.get((row.episode_id, row.seat)),
            delay_ms=row.delay_ms,
            unused=row.unused,
        )


def _decision_times(connection: Connection, ids: Sequence[int]) -> dict[tuple[int, int], float]:
    its = STEPS.c
    query = sa.select(its.episode_id, its.seat, sa.func.sum(its.ms), sa.func.count(its.ms))
    wanted = query.where(its.episode_id.in_(ids) & (its.activity == "acted"))
    rows: Any = connection.execute(wanted.group_by(its.episode_id, its.seat))
    return {(number, seat): int(total) / count for number, seat, total, count in rows if count}


def _count_interruptions(
    connection: Connection, ids: Sequence[int], found: dict[int, Counter[str]]
) -> None:
    its, present = EVENTS.c, dict[tuple[int, int | None], bool]()
    wanted = its.episode_id.in_(ids) & its.kind.in_(("roster", "paused", "restarted"))
    query = sa.select(its.episode_id, its.kind, its.seat, its.details).where(wanted)
    for number, kind, seat, details in connection.execute(
        query.order_by(its.episode_id, its.number)
    ):
        name = kind
        if kind == "roster":
            # A roster entry repeats the participant's state. Only a change counts as an absence.
            was, now = present.get((number, seat), False), bool(json.loads(details)["present"])
            present[number, seat] = now
            if now or not was:
                continue
            name = "absences"
        found.setdefault(number, Counter())[name] += 1


# Groups


class SeatRole(NamedTuple):
    """Seats of a group with the same player and kind. An empty player means all players."""

    player: str
    kind: str
    seats: list[SeatFacts]


@dataclass(frozen=True, slots=True)
class Group:
    """Episodes with one value of the label, and their seats."""

    name: str
    episodes: tuple[EpisodeFacts, ...]
    seats: tuple[SeatFacts, ...]

    def roles(self) -> list[SeatRole]:
        """Return the seats by player and kind of participant.

        The players of a task may have different work, so their seats are not averaged. With more
        than `MAX_PLAYERS` players, all players are one role.
        """
        players = in_order({seat.player for seat in self.seats})
        separate = 1 < len(players) <= MAX_PLAYERS
        found: dict[tuple[str, str], list[SeatFacts]] = {}
        kinds = {seat.kind for seat in self.seats}
        order = [kind for kind in KINDS if kind in kinds] + sorted(kinds - KINDS.keys())
        for player, kind in product(players if separate else [""], order):
            seats = [s for s in self.seats if s.kind == kind and player in ("", s.player)]
            if seats:
                found[short_label(player, 24), KINDS.get(kind, kind)] = seats
        return [SeatRole(player, kind, seats) for (player, kind), seats in found.items()]


@dataclass(frozen=True, slots=True)
class Groups:
    """Groups that are compared. `left_out` has the names and sizes of the groups beyond those."""

    shown: tuple[Group, ...]
    left_out: dict[str, int]


def grouped(facts: Facts) -> Groups:
    """Return the groups of a report. Episodes without the label form one group."""
    episodes: dict[str | None, list[EpisodeFacts]] = {}
    for each in facts.episodes:
        episodes.setdefault(each.group, []).append(each)
    seats: dict[str | None, list[SeatFacts]] = {}
    for seat in facts.seats:
        seats.setdefault(seat.episode.group, []).append(seat)
    values: list[str | None] = [*in_order(name for name in episodes if name is not None)]
    values += [None] if None in episodes else []
    largest = set(sorted(values, key=lambda value: -len(episodes[value]))[:MAX_GROUPS])
    names = _group_names(values, facts.by)
    shown = tuple(
        Group(names[value], tuple(sorted(episodes[value], key=_place)), tuple(seats[value]))
        for value in values
        if value in largest
    )
    left_out = {names[value]: len(episodes[value]) for value in values if value not in largest}
    return Groups(shown, left_out)


def in_order(values: Iterable[str]) -> list[str]:
    """Return the values in natural order: `2` comes before `10`."""
    return sorted(values, key=_natural)


def _natural(value: str) -> tuple[list[tuple[int, int | str]], str]:
    # Python refuses to convert more than 4300 digits, and labels come from strangers.
    parts = re.findall(r"[0-9]{1,18}|[^0-9]+|[0-9]+", value)
    return [
        (0, int(part)) if part.isdecimal() and len(part) <= 18 else (1, part) for part in parts
    ], value


def _place(episode: EpisodeFacts) -> tuple[object, ...]:
    """Sort by pair and round, with episodes without a pair at the end."""
    pair, number = episode.pair, episode.round
    return (
        pair is None, _natural(pair or ""), _natural(number or ""), episode.created, episode.name,
        episode.id,
    )  # fmt: skip


def _group_names(values: Iterable[str | None], by: str) -> dict[str | None, str]:
    """Return a printable name for each value. Names that would be equal get numbers."""
    found: dict[str | None, str] = {}
    for value in values:
        name = f"(no {by})" if value is None else short_label(value, 40) or "(empty)"
        label, number = short_label(name), 2
        while label in found.values():
            label, number = f"{short_label(name, 38)} #{number}", number + 1
        found[value] = label
    return found
