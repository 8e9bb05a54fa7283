"""Episodes by the value of a label: which groups are compared, and what they are called."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from robotouille_client.console.pages.drawing import plain
from robotouille_data.answers.report.facts import Episode, Facts, Seat

__all__ = ["KINDS", "MAX_GROUPS", "Group", "Groups", "Role", "grouped", "in_order"]

MAX_GROUPS = 8
"""Groups that are compared: those with most episodes."""
MAX_PLAYERS = 4
"""Players of a task that are told apart."""
KINDS = {"human": "people", "bot": "bots", "model": "models", "": "nobody"}


class Role(NamedTuple):
    """Seats of a group that are alike: their player (empty: all players), what plays them."""

    player: str
    kind: str
    seats: list[Seat]


@dataclass(frozen=True, slots=True)
class Group:
    """The episodes with one value of the label, and their seats."""

    name: str
    episodes: tuple[Episode, ...]
    seats: tuple[Seat, ...]

    def roles(self) -> list[Role]:
        """The seats by the player that they move and by what plays them: roles of a task may have
        little in common. Of more players than `MAX_PLAYERS` all are one."""
        players = in_order({seat.player for seat in self.seats})
        told = 1 < len(players) <= MAX_PLAYERS
        found: dict[tuple[str, str], list[Seat]] = {}
        kinds = {seat.kind for seat in self.seats}
        order = [kind for kind in KINDS if kind in kinds] + sorted(kinds - KINDS.keys())
        for player, kind in product(players if told else [""], order):
            seats = [s for s in self.seats if s.kind == kind and player in ("", s.player)]
            if seats:
                found[plain(player, 24), KINDS.get(kind, kind)] = seats
        return [Role(player, kind, seats) for (player, kind), seats in found.items()]


@dataclass(frozen=True, slots=True)
class Groups:
    """The groups that are compared, and those that are too many, by name with their episodes."""

    shown: tuple[Group, ...]
    left_out: dict[str, int]


def grouped(facts: Facts) -> Groups:
    """The groups of a report; episodes without the label are one."""
    episodes: dict[str | None, list[Episode]] = {}
    for each in facts.episodes:
        episodes.setdefault(each.group, []).append(each)
    seats: dict[str | None, list[Seat]] = {}
    for seat in facts.seats:
        seats.setdefault(seat.episode.group, []).append(seat)
    names = [*in_order(name for name in episodes if name is not None)]
    values: list[str | None] = [*names, *([None] if None in episodes else [])]
    largest = set(sorted(values, key=lambda value: -len(episodes[value]))[:MAX_GROUPS])
    labels = _labels(values, facts.by)
    shown = tuple(
        Group(labels[value], tuple(sorted(episodes[value], key=_place)), tuple(seats[value]))
        for value in values
        if value in largest
    )
    left_out = {labels[value]: len(episodes[value]) for value in values if value not in largest}
    return Groups(shown, left_out)


def in_order(values: Iterable[str]) -> list[str]:
    """Values as people order them: `2` is before `10`."""
    return sorted(values, key=_natural)


def _natural(value: str) -> tuple[list[tuple[int, int | str]], str]:
    parts = re.findall(r"[0-9]{1,18}|[^0-9]+|[0-9]+", value)
    return [
        (0, int(part)) if part.isdecimal() and len(part) <= 18 else (1, part) for part in parts
    ], value


def _place(episode: Episode) -> tuple[object, ...]:
    """Pairs, and of each its rounds; what has no pair is behind."""
    pair, number = episode.pair, episode.round
    return (
        pair is None, _natural(pair or ""), _natural(number or ""), episode.created, episode.name,
        episode.id,
    )  # fmt: skip


def _labels(values: Iterable[str | None], by: str) -> dict[str | None, str]:
    """What groups are called: their value as it can be drawn, with a number where two are alike."""
    found: dict[str | None, str] = {}
    for value in values:
        name = f"(no {by})" if value is None else plain(value, 40) or "(empty)"
        label, number = plain(name), 2
        while label in found.values():
            label, number = f"{plain(name, 38)} #{number}", number + 1
        found[value] = label
    return found
