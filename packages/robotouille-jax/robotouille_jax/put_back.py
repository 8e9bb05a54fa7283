"""The return of served and discarded things to their places, as in `robotouille.world.shift`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from robotouille.batch.rules import CompiledRules
from robotouille.world.shift import Return, ShiftRules
from robotouille_jax.padded import Array, ints, rows

_Row = tuple[int, int, int]


class _Tables(NamedTuple):
    """Numbers of a kitchen; atoms are padded with a number beyond the last atom.

    Rows of `own`, `order` and so on are things in the order of their names, in which they return.
    The first four arrays have one row for each relation of two things, or of a thing and a station.

    Attributes:
        on_surface: By surface and thing, the atom that puts the thing there.
        own: Facts that a thing gets back.
        order: Stations to which a thing returns, the best first.
        here: By thing and station, atoms that put the thing there.
        bottom: By thing and station, atoms of the lowest thing.
        next: By thing and thing below, atoms of a thing on another one.
        top: Atoms of a thing with nothing on it.
        rank: Order of the things in the search for the top of a stack.
        type: The type of each thing.
        soils: Atoms that a served thing loses.
    """

    pair_atom: Array
    pair: Array
    place_atom: Array
    place: Array
    on_surface: Array
    own: Array
    order: Array
    here: Array
    bottom: Array
    next: Array
    top: Array
    rank: Array
    type: Array
    soils: Array


class _Numbers:
    """Numbers of the things that return, of the stations and of the atoms about them.

    Attributes:
        things: Names of the things. All are there from the beginning: nothing can be created.
        stations: Names of the stations.
        none: A number beyond the last atom, for missing ones.
    """

    def __init__(self, rules: CompiledRules, returns: Return) -> None:
        self._rules, self._returns = rules, returns
        self.things = sorted(returns.homes)
        self.stations = [station.name for station in returns.stations]
        self.none = len(rules.encoding.atoms)

    def tables(self, surfaces: Sequence[Mapping[int, str]]) -> _Tables:
        rules, returns, names = self._rules, self._returns, self.things
        pairs, places = self._related()
        types = {o.name: o.type for o in rules.encoding.objects}
        kinds = sorted({types[name] for name in names})
        by_type = [name for kind in kinds for name in rules.world.table.by_type[kind]]
        ranked = [name for name in by_type if name in names]
        return _Tables(
            pair_atom=ints(atom for atom, _, _ in pairs),
            pair=_two_columns([pair for _, *pair in pairs]),
            place_atom=ints(atom for atom, _, _ in places),
            place=_two_columns([place for _, *place in places]),
            on_surface=rows(map(self._on_surface, surfaces), self.none),
            own=rows((rules.atoms_of(returns.own_facts(name)) for name in names), self.none),
            order=rows(map(self._order, names), -1),
            here=self._block("shares_tile", self.stations),
            bottom=self._block("bottom_of_stack", self.stations),
            next=self._block("next_in_stack", names),
            top=self._about_each(returns.rules["top_of_stack"]),
            rank=ints(ranked.index(name) for name in names),
            type=ints(kinds.index(types[name]) for name in names),
            soils=self._about_each(sorted(returns.soils)),
        )

    def defaults(self) -> list[tuple[Array, Array]]:
        """Return for each default fact its atoms by object, and the atoms that prevent it."""
        atoms = self._rules.encoding.atoms
        return [
            (
                rows((self._find([fact], name) for name in self._rules.object), self.none)[:, 0],
                jnp.asarray([predicate in (unless or ()) for predicate, *_ in atoms]),
            )
            for fact, unless in self._returns.defaults
        ]

    def _related(self) -> tuple[list[_Row], list[_Row]]:
        """Return the atoms about two things, and those about a station and a thing."""
        thing = {name: i for i, name in enumerate(self.things)}
        station = {name: i for i, name in enumerate(self.stations)}
        pairs, places = [], []
        for atom, (_, *arguments) in enumerate(self._rules.encoding.atoms):
            found = [thing[name] for name in arguments if name in thing]
            pairs += [(atom, i, j) for i in found for j in found if i != j]
            there = [station[name] for name in arguments if name in station]
            places += [(atom, s, i) for s in there for i in found]
        return pairs, places

    def _on_surface(self, surface: Mapping[int, str]) -> list[int]:
        """Return for each thing the first atom that puts it on a surface."""
        first: dict[str, int] = {}
        for bit, name in surface.items():
            for atom in self._rules.atoms_of(bit):
                first.setdefault(name, atom)
        return [first.get(name, self.none) for name in self.things]

    def _order(self, name: str) -> list[int]:
        home = self._returns.homes[name]
        return [self.stations.index(s) for s in self._returns.stations_for(home)] if home else [-1]

    def _block(self, rule: str, others: Sequence[str]) -> Array:
        predicates = self._returns.rules[rule]
        found = (self._find(predicates, a, b) for a in self.things for b in others)
        return rows(found, self.none).reshape(len(self.things), len(others), -1)

    def _about_each(self, predicates: Sequence[str]) -> Array:
        return rows((self._find(predicates, name) for name in self.things), self.none)

    def _find(self, predicates: Sequence[str], *arguments: str) -> tuple[int, ...]:
        mask = self._rules.world.table.mask((p, *arguments) for p in predicates)
        return self._rules.atoms_of(mask)


def _two_columns(found: Sequence[Sequence[int]]) -> Array:
    return jnp.asarray(np.array(found, np.int32).reshape(-1, 2))


class PutBack:
    """Returns things to where they were at the beginning of the task.

    Attributes:
        surfaces: Number of stations that discard or serve. The first `discarding` ones discard.
        objects: Number of objects.
    """

    def __init__(self, rules: CompiledRules, shift: ShiftRules, mentions: Array) -> None:
        names = _Numbers(rules, shift.returns)
        surfaces = [*shift.discarding.values(), *shift.serving.values()]
        self._mentions, self.objects = mentions, len(rules.object)
        self._atoms = names.none
        self._things = ints(rules.object[name] for name in names.things)
        self._stations = ints(rules.object[name] for name in names.stations)
        self.discarding, self.surfaces = len(shift.discarding), len(surfaces)
        self._t = names.tables(surfaces)
        self._defaults = names.defaults()

    def things_at(self, surface: Array, atoms: Array) -> Array:
        """Return the things on a surface, with what is in or on them."""
        t, count = self._t, len(self._things)
        found = _get(atoms, t.on_surface[surface])
        related = jnp.zeros((count, count), bool)
        related = related.at[t.pair[:, 0], t.pair[:, 1]].max(atoms[t.pair_atom])

        def reach(_: Array, found: Array) -> Array:
            return found | jnp.any(related & found[:, None], axis=0)

        reached: Array = jax.lax.fori_loop(0, count, reach, found)
        return reached

    def alone(self, atoms: Array, things: Array) -> Array:
        """Return the atoms that are about none of the other things."""
        return atoms & ~self._about(~things)

    def put_back(self, atoms: Array, things: Array, soiled: Array) -> tuple[Array, Array]:
        """Return the atoms after things have returned, and which objects these are."""
        t, about = self._t, self._about(things)
        touched = jnp.any(self._mentions & (atoms & about), axis=1)
        soils = jnp.zeros_like(atoms).at[t.soils].set(True, mode="drop")
        clean = atoms & about & soils & ~soiled
        atoms &= ~about

        def place(thing: Array, both: tuple[Array, Array]) -> tuple[Array, Array]:
            atoms, touched = both
            station, below, piled = self._place(atoms, thing)
            when = things[thing] & (t.order[thing, 0] >= 0)
            under = jnp.where(when & piled, t.top[below], self._atoms)
            atoms = atoms.at[under].set(False, mode="drop")
            position = jnp.where(piled, self._atoms, t.bottom[thing, station])
            on = jnp.where(piled, t.next[thing, below], self._atoms)
            for new in (t.own[thing], t.here[thing, station], position, on, t.top[thing]):
                atoms = atoms.at[jnp.where(when, new, self._atoms)].set(True, mode="drop")
            at = jnp.stack([self._things[thing], self._stations[station]])
            return atoms, touched.at[jnp.where(when, at, self.objects)].set(True, mode="drop")

        atoms, touched = jax.lax.fori_loop(0, len(self._things), place, (atoms, touched))
        returned = jnp.zeros(self.objects, bool).at[self._things].set(things)
        return self._with_defaults(atoms | clean, touched), returned

    def _place(self, atoms: Array, thing: Array) -> tuple[Array, Array, Array]:
        """Return a thing's station, the thing below it, and whether there is one."""
        t = self._t
        there = jnp.zeros((len(self._stations), len(self._things)), bool)
        there = there.at[t.place[:, 0], t.place[:, 1]].max(atoms[t.place_atom])
        same = t.type == t.type[thing]
        alike = ~jnp.any(there & ~same, axis=1)
        here = jnp.any(_get(atoms, t.here), axis=-1) & jnp.any(_get(atoms, t.top), axis=-1)[:, None]
        tops = here & same[:, None]
        piled = jnp.any(tops, axis=0)
        below = jnp.argmin(jnp.where(tops, t.rank[:, None], len(t.rank)), axis=0)
        order = t.order[thing]
        home = order[0]
        room = ~jnp.any(there, axis=1)
        room = room.at[home].set(room[home] | (alike[home] & piled[home]))
        fits = room[order] & (order >= 0)
        station = jnp.where(fits.any(), order[jnp.argmax(fits)], home)
        return station, below[station], piled[station]

    def _about(self, things: Array) -> Array:
        return jnp.any(self._mentions[self._things] & things[:, None], axis=0)

    def _with_defaults(self, atoms: Array, touched: Array) -> Array:
        for default, spoilers in self._defaults:
            spoiled = jnp.any(self._mentions & (atoms & spoilers), axis=1)
            places = jnp.where(touched, default, self._atoms)
            atoms = atoms.at[places].set(~spoiled, mode="drop")
        return atoms


def _get(atoms: Array, places: Array) -> Array:
    return atoms.at[places].get(mode="fill", fill_value=False)
