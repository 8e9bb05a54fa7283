"""Episodes in parts such that nobody is in two of them."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille.protocol.participant_names import likeness
from robotouille_data.database import in_pieces
from robotouille_data.exports.people import sittings, spectators_heard
from robotouille_data.schema import LABELS

__all__ = ["groups", "split"]


def groups(connection: Connection, ids: Sequence[int], label: str) -> list[tuple[int, ...]]:
    """Episodes that belong together: they share a human participant, or the value of a label, or
    both do so with a third one."""
    links = _shared_people(connection, ids)
    query = sa.select(LABELS.c.episode_id, LABELS.c.value).where(LABELS.c.name == label)
    for piece in in_pieces(ids):
        for episode_id, value in connection.execute(query.where(LABELS.c.episode_id.in_(piece))):
            links[value].append(episode_id)
    parents = {number: number for number in ids}
    for linked in links.values():
        first = _root(parents, linked[0])
        for other in linked[1:]:
            parents[_root(parents, other)] = first
    found: dict[int, list[int]] = defaultdict(list)
    for number in sorted(ids):
        found[_root(parents, number)].append(number)
    return [tuple(members) for members in found.values()]


def _shared_people(connection: Connection, ids: Sequence[int]) -> defaultdict[Hashable, list[int]]:
    """The episodes of each human participant.

    Who played, or said something as a spectator, without a pseudonym may be anybody of the same
    name, with a pseudonym or without. Who has never played is no participant.
    """
    links: defaultdict[Hashable, list[int]] = defaultdict(list)
    known: dict[str, list[int]] = defaultdict(list)
    unknown: dict[str, list[int]] = defaultdict(list)
    for sitting in sittings(connection, ids):
        if sitting.kind == "human":
            by_name = known if sitting.person.by_pseudonym else unknown
            by_name[likeness(sitting.name)].append(sitting.episode_id)
            if sitting.person.by_pseudonym:
                links[sitting.person].append(sitting.episode_id)
    played = known.keys() | unknown.keys()
    for episode_id, name in spectators_heard(connection, ids):
        if likeness(name) in played:
            unknown[likeness(name)].append(episode_id)
    for like, episodes in unknown.items():
        links["name", like] = episodes + known.get(like, [])
    return links


def _root(parents: dict[int, int], number: int) -> int:
    while parents[number] != number:
        parents[number] = number = parents[parents[number]]
    return number


def split(
    together: Sequence[tuple[int, ...]], shares: Mapping[str, float]
) -> dict[str, tuple[int, ...]]:
    """Groups of episodes dealt out to parts.

    The largest come first, those of one size in the order of a hash, each to the part that lacks
    most. So it depends on the episodes alone.

    Args:
        shares: What share of the episodes each part is to have.
    """
    total = sum(map(len, together)) / sum(shares.values())
    found: dict[str, list[int]] = {name: [] for name in shares}
    for members in sorted(together, key=lambda each: (-len(each), _hash(each))):
        neediest = max(shares, key=lambda name: shares[name] * total - len(found[name]))
        found[neediest] += members
    return {name: tuple(sorted(members)) for name, members in found.items()}


def _hash(members: tuple[int, ...]) -> bytes:
    return hashlib.sha256(repr(members).encode()).digest()
