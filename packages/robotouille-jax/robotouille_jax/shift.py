"""Shifts in JAX: orders arrive, are served, and expire, as in `robotouille.world.shift`."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from robotouille.batch.rules import CompiledRules, goal_rule
from robotouille.errors import RobotouilleError
from robotouille.world.shift import ShiftRules
from robotouille_jax.goal_progress import progress_of
from robotouille_jax.goal_search import goal_reached
from robotouille_jax.padded import Array, goal_table, ints
from robotouille_jax.put_back import PutBack

LATEST = 1 << 30


class CopyOrders(NamedTuple):
    """Orders of a copy; see `robotouille.world.shift.Orders`.

    Attributes:
        number: Numbers of the open orders in the order of their arrival, then -1.
        due: The step in which each of them expires.
    """

    time: Array
    number: Array
    due: Array
    arrived: Array
    score: Array
    served: Array
    expired: Array


class JaxShift:
    """The rules of a shift as pure functions of one copy.

    Attributes:
        steps: The length of the shift.
        initial: The first orders.

    Raises:
        RobotouilleError: Objects can be created: `ShiftRules` uses the names of returned objects
            again, which slots cannot represent. Or only facts that never change describe a part of
            a dish, so the facts do not tell which things are the dish.
    """

    def __init__(self, rules: CompiledRules, shift: ShiftRules, mentions: Array) -> None:
        if any(rules.exists):
            raise RobotouilleError(
                f"{rules.world.task.name}: JaxBatch does not support shifts in which objects are "
                "created; use the environments"
            )
        if vague := [name for name in shift.menu if _is_vague(shift, name, rules)]:
            raise RobotouilleError(
                f"{rules.world.task.name}: JaxBatch does not support the dish {vague[0]!r}, "
                "which has a part that no changing condition is about; use the environments"
            )
        self.steps = shift.steps
        self._most = shift.most_open
        self._put_back = PutBack(rules, shift, mentions)
        names = list(shift.menu)
        self._at = ints([*(at for at, _ in shift.arrivals), LATEST])
        self._dish = ints([*(names.index(dish) for _, dish in shift.arrivals), 0])
        menu = [shift.menu[name] for name in names]
        self._points, self._tip, self._penalty = (
            ints(getattr(dish, name) for dish in menu) for name in ("points", "tip", "penalty")
        )
        self._patience = ints(shift.patience_for(name) for name in names)
        self._parts = ints(shift.parts[name] for name in names)
        atoms = len(rules.encoding.atoms)
        goals = [
            goal_rule(rules.world, shift.goal(name), rules.atom, rules.object) for name in names
        ]
        self._goals = [goal_table(goal, atoms) for goal in goals]
        self._progress = [progress_of(goal, atoms) for goal in goals]
        zero = jnp.zeros((), jnp.int32)
        none = jnp.full(self._most, -1, jnp.int32)
        self.initial = self._arrive(
            CopyOrders(zero, none, jnp.zeros(self._most, jnp.int32), zero, zero, zero, zero)
        )

    def advance(self, atoms: Array, orders: CopyOrders) -> tuple[Array, Array, CopyOrders]:
        """Return the atoms, which objects returned, and the orders after a step."""
        before, over = (atoms, orders), orders.time >= self.steps
        orders = orders._replace(time=orders.time + 1)
        put_back = self._put_back

        def visit(
            surface: Array, both: tuple[Array, Array, CopyOrders]
        ) -> tuple[Array, Array, CopyOrders]:
            atoms, gone, orders = both
            things = put_back.things_at(surface, atoms)
            serves = surface >= put_back.discarding
            served, orders = self._served(atoms, things, orders, serves)
            things &= served | ~serves
            atoms, returned = put_back.put_back(atoms, things, serves)
            return atoms, gone | returned, orders

        none = jnp.zeros(put_back.objects, bool)
        atoms, gone, orders = jax.lax.fori_loop(0, put_back.surfaces, visit, (atoms, none, orders))
        orders = self._arrive(self._expire(orders))
        atoms, orders = jax.tree.map(
            lambda old, new: jnp.where(over, old, new), before, (atoms, orders)
        )
        return atoms, gone & ~over, orders

    def vector(self, orders: CopyOrders) -> Array:
        """Return the orders as numbers of a vector; see `Encoding`."""
        dishes = jnp.arange(len(self._points))
        own = (orders.number >= 0)[:, None] & (self._dish[orders.number][:, None] == dishes)
        left = jnp.where(own, (orders.due - orders.time)[:, None], 0)
        return jnp.concatenate([(self.steps - orders.time)[None], left.reshape(-1)])

    def potential(self, atoms: Array, orders: CopyOrders) -> Array:
        """Return minus the share of unmet conditions of the nearest dish that is ordered."""
        each = jnp.stack([progress(atoms) for progress in self._progress])
        ordered = (orders.number >= 0)[:, None] & (
            self._dish[orders.number][:, None] == jnp.arange(len(each))
        )
        return jnp.max(jnp.where(ordered.any(0), each, -1.0))

    def _served(
        self, atoms: Array, things: Array, orders: CopyOrders, serves: Array
    ) -> tuple[Array, CopyOrders]:
        """Serve the things to the order for them that expires first, if there is one."""
        alone = self._put_back.alone(atoms, things)
        dishes = jnp.stack([goal_reached(goal, alone) for goal in self._goals])
        dishes &= (self._parts == things.sum()) & serves & things.any()
        fits = (orders.number >= 0) & dishes[self._dish[orders.number]]
        chosen = jnp.argmin(jnp.where(fits, orders.due, LATEST))
        found = fits.any()
        dish = self._dish[orders.number[chosen]]
        left = jnp.maximum(orders.due[chosen] - orders.time, 0)
        worth = self._points[dish] + self._tip[dish] * left // self._patience[dish]
        orders = _without(orders, found & (jnp.arange(self._most) == chosen))
        return found, orders._replace(
            score=orders.score + jnp.where(found, worth, 0), served=orders.served + found
        )

    def _expire(self, orders: CopyOrders) -> CopyOrders:
        late = (orders.number >= 0) & (orders.due <= orders.time)
        lost = jnp.where(late, self._penalty[self._dish[orders.number]], 0).sum()
        orders = orders._replace(
            score=orders.score - lost, expired=orders.expired + late.sum(dtype=jnp.int32)
        )
        return _without(orders, late)

    def _arrive(self, orders: CopyOrders) -> CopyOrders:
        for _ in range(self._most):
            count = (orders.number >= 0).sum()
            due = (count < self._most) & (self._at[orders.arrived] <= orders.time)
            place = jnp.where(due, count, self._most)
            expires = orders.time + self._patience[self._dish[orders.arrived]]
            orders = orders._replace(
                number=orders.number.at[place].set(orders.arrived, mode="drop"),
                due=orders.due.at[place].set(expires, mode="drop"),
                arrived=orders.arrived + due,
            )
        return orders


def _without(orders: CopyOrders, gone: Array) -> CopyOrders:
    """Remove open orders; those that are left keep their order."""
    kept = (orders.number >= 0) & ~gone
    place = jnp.where(kept, jnp.cumsum(kept) - 1, len(kept))
    return orders._replace(
        number=jnp.full_like(orders.number, -1).at[place].set(orders.number, mode="drop"),
        due=jnp.zeros_like(orders.due).at[place].set(orders.due, mode="drop"),
    )


def _is_vague(shift: ShiftRules, name: str, rules: CompiledRules) -> bool:
    """Return whether no condition that can change is about some part of a dish."""
    goal, fluents = shift.goal(name), rules.world.table.fluents
    described = {i for term in goal.terms if term.predicate in fluents for i in term.ids}
    others = (goal.candidates(i) for i in goal.variables if i not in described)
    return any(shift.returns.movable.intersection(names) for names in others)
