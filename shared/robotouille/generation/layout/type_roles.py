"""What the types of a domain are to a generator, found from its definitions alone."""

from __future__ import annotations

from dataclasses import dataclass

from robotouille.domain.schema import DomainFile

__all__ = ["Roles"]


@dataclass(frozen=True, slots=True)
class Roles:
    """The types of a domain by what one can do with their objects.

    `placeable` things stand on stations, `holdable` ones can be in a player's hands, `stackable`
    ones lie on one another, `vessels` are placeable things that others are put into. What is
    neither placeable nor a station nor a player (a filling) goes where its vessel goes.
    """

    stations: tuple[str, ...]
    players: tuple[str, ...]
    placeable: tuple[str, ...]
    holdable: tuple[str, ...]
    stackable: tuple[str, ...]
    vessels: tuple[str, ...]

    @staticmethod
    def of(domain: DomainFile) -> Roles:
        """The roles that the layout rules and predicates of a domain give to its types."""
        types = {p.name: p.param_types for p in domain.predicate_defs}
        stations, players = domain.station_types, domain.player_types
        movable = [t for t in domain.object_types if t not in (*stations, *players)]
        rules = domain.layout or ()
        shared = [types[r.predicate] for r in rules if r.when == "shares_tile"]
        stacked = [types[r.predicate] for r in rules if r.when == "next_in_stack"]
        pairs = [pair for pair in types.values() if len(pair) == 2]

        def shares(kind: str, hosts: tuple[str, ...]) -> bool:
            return any(kind in pair and any(h in pair for h in hosts) for pair in shared)

        def contains(kind: str) -> bool:
            return any(kind == b != a and a in movable for a, b in pairs)

        placeable = tuple(t for t in movable if shares(t, stations))
        return Roles(
            stations=stations,
            players=players,
            placeable=placeable,
            holdable=tuple(t for t in movable if shares(t, players)),
            stackable=tuple(t for t in placeable if (t, t) in stacked),
            vessels=tuple(t for t in placeable if contains(t)),
        )
