"""The return of served and discarded things to their places, as in `robotouille.world.shift`."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from robotouille.batch.rules import CompiledRules
from robotouille.world.shift import ShiftRules
from robotouille_jax.padded import Array, ints, rows


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


class PutBack:
    """Returns things to where they were at the beginning of the task.

    Attributes:
        surfaces: Number of stations that discard or serve. The first `discarding` ones discard.
        objects: Number of objects.
    """

    def __init__(self, rules: CompiledRules, shift: ShiftRules, mentions: Array) -> None:
        returns, self._mentions, self.objects = shift.returns, mentions, len(rules.object)
        self._atoms = len(rules.encoding.atoms)
        # All objects of the problem are there from the beginning: nothing can be created.
        names = sorted(returns.homes)
        self._things = ints(rules.object[name] for name in names)
        stations = [station.name for station in returns.stations]
        self._stations = ints(rules.object[name] for name in stations)
        self.discarding = len(shift.discarding)
        surfaces = [*shift.discarding.values(), *shift.serving.values()]
        self.surfaces = len(surfaces)
        types = {o.name: o.type for o in rules.encoding.objects}
        kinds = sorted({types[name] for name in names})
        table = rules.world.table
        related = [
            (number, [names.index(n) for n in arguments if n in names], arguments)
            for number, (_, *arguments) in enumerate(rules.encoding.atoms)
        ]
        pairs = [(n, i, j) for n, found, _ in related for i in found for j in found if i != j]
        places = [
            (n, stations.index(station), i)
            for n, found, arguments in related
            for station in arguments
            if station in stations
            for i in found
        ]
        by_type = [name for kind in kinds for name in table.by_type[kind] if name in names]

        def atoms(predicates: list[str], *arguments: str) -> tuple[int, ...]:
            return rules.atoms_of(table.mask((p, *arguments) for p in predicates))

        def block(predicates: list[str], others: list[str]) -> Array:
            found = rows((atoms(predicates, a, b) for a in names for b in others), self._atoms)
            return found.reshape(len(names), len(others), -1)

        homes = [returns.homes[name] for name in names]
        orders = [
            [stations.index(s) for s in returns.stations_for(home)] if home else [-1]
            for home in homes
        ]
        on_surface = [
            [
                next((i for bit, thing in surface.items() for i in rules.atoms_of(bit)
                      if thing == name), self._atoms)
                for name in names
            ]
            for surface in surfaces
        ]  # fmt: skip
        self._t = _Tables(
            pair_atom=ints(n for n, _, _ in pairs),
            pair=jnp.asarray(np.array([(i, j) for _, i, j in pairs], np.int32).reshape(-1, 2)),
            place_atom=ints(n for n, _, _ in places),
            place=jnp.asarray(np.array([(s, i) for _, s, i in places], np.int32).reshape(-1, 2)),
            on_surface=rows(on_surface, self._atoms),
            own=rows((rules.atoms_of(returns.own_facts(name)) for name in names), self._atoms),
            order=rows(orders, -1),
            here=block(returns.rules["shares_tile"], stations),
            bottom=block(returns.rules["bottom_of_stack"], stations),
            next=block(returns.rules["next_in_stack"], names),
            top=rows((atoms(returns.rules["top_of_stack"], name) for name in names), self._atoms),
            rank=ints(by_type.index(name) for name in names),
            type=ints(kinds.index(types[name]) for name in names),
            soils=rows((atoms(sorted(returns.soils), name) for name in names), self._atoms),
        )
        self._defaults = [
            (
                rows((atoms([predicate], name) for name in rules.object), self._atoms)[:, 0],
                jnp.asarray([a[0] in (unless or ()) for a in rules.encoding.atoms]),
            )
            for predicate, unless in returns.defaults
        ]

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
