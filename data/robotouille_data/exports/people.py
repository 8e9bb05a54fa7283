"""Participants of exported episodes, and a split without shared participants."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille.protocol.participant_names import likeness
from robotouille_data.database import in_pieces
from robotouille_data.schema import EVENTS, LABELS


@dataclass(frozen=True, slots=True)
class Person:
    """Participant across episodes.

    Participants without a token have no pseudonym. Two of them with the same name count as one.
    """

    name: str
    by_pseudonym: bool

    @classmethod
    def of(cls, name: str, pseudonym: str) -> Person:
        """Return the person with this pseudonym or, if it is empty, with this name."""
        return cls(pseudonym, True) if pseudonym else cls(name, False)


@dataclass(frozen=True, slots=True)
class Participation:
    """Participation of a person in an episode, with the name and kind that they had there."""

    episode_id: int
    name: str
    kind: str
    person: Person


def participations(connection: Connection, ids: Sequence[int]) -> Iterator[Participation]:
    """Yield everyone who had a seat in the episodes, including those who were replaced later.

    A participant who left and returned appears more than once.
    """
    columns = EVENTS.c.episode_id, EVENTS.c.name, EVENTS.c.details
    query = sa.select(*columns).where(EVENTS.c.kind == "roster", EVENTS.c.name != "")
    order = EVENTS.c.episode_id, EVENTS.c.number
    for piece in in_pieces(ids):
        its = query.where(EVENTS.c.episode_id.in_(piece)).order_by(*order)
        for episode_id, name, details in connection.execute(its):
            told = json.loads(details)
            person = Person.of(name, told.get("participant", ""))
            yield Participation(episode_id, name, told["kind"], person)


def spectators_heard(connection: Connection, ids: Sequence[int]) -> Iterator[tuple[int, str]]:
    """Yield the episodes and names of spectators who wrote messages."""
    said = (EVENTS.c.kind == "said") & EVENTS.c.seat.is_(None) & (EVENTS.c.name != "")
    query = sa.select(EVENTS.c.episode_id, EVENTS.c.name).where(said).distinct()
    for piece in in_pieces(ids):
        found = connection.execute(query.where(EVENTS.c.episode_id.in_(piece)))
        yield from ((episode_id, name) for episode_id, name in found)


def groups(connection: Connection, ids: Sequence[int], label: str) -> list[tuple[int, ...]]:
    """Return groups of episodes that must not be separated.

    Episodes belong together if they share a human participant or the value of the label, directly
    or through other episodes.
    """
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
    """Return the episodes of each human participant.

    A player or spectator without a pseudonym could be anyone with a similar name. Their episodes
    are therefore linked to all episodes with that name. People who only watched are not
    participants.
    """
    links: defaultdict[Hashable, list[int]] = defaultdict(list)
    known: dict[str, list[int]] = defaultdict(list)
    unknown: dict[str, list[int]] = defaultdict(list)
    for participation in participations(connection, ids):
        if participation.kind == "human":
            by_name = known if participation.person.by_pseudonym else unknown
            by_name[likeness(participation.name)].append(participation.episode_id)
            if participation.person.by_pseudonym:
                links[participation.person].append(participation.episode_id)
    played = known.keys() | unknown.keys()
    for episode_id, name in spectators_heard(connection, ids):
        if likeness(name) in played:
            unknown[likeness(name)].append(episode_id)
    for like, episodes in unknown.items():
        links["name", like] = episodes + known.get(like, [])
    return links


def _root(parents: dict[int, int], number: int) -> int:
    while parents[number] != number:
        parents[number] = number = parents[parents[number]]  # Path halving keeps trees flat.
    return number


def split(
    together: Sequence[tuple[int, ...]], shares: Mapping[str, float]
) -> dict[str, tuple[int, ...]]:
    """Assign groups of episodes to parts.

    Groups are assigned from the largest to the smallest, each to the part that lacks the most
    episodes. Groups of equal size are ordered by a hash, so the result depends only on the
    episodes and the shares.

    Args:
        shares: Share of the episodes for each part.
    """
    total = sum(map(len, together)) / sum(shares.values())
    found: dict[str, list[int]] = {name: [] for name in shares}
    # Large groups first: small ones can then fill the gaps, which keeps the shares close.
    for members in sorted(together, key=lambda each: (-len(each), _hash(each))):
        neediest = max(shares, key=lambda name: shares[name] * total - len(found[name]))
        found[neediest] += members
    return {name: tuple(sorted(members)) for name, members in found.items()}


def _hash(members: tuple[int, ...]) -> bytes:
    return hashlib.sha256(repr(members).encode()).digest()
