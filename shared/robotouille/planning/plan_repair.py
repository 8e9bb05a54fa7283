"""Plan repair: adapts a known plan to another state, without a search.

    trace = PlanRepair(world).repair(errands(trace), state)

Players seldom leave a plan for good. They walk elsewhere, hold an object, or do a later action
early. Most of the plan's actions are still useful in their order. The repair leaves out actions
whose effect is present, computes the walks again, and inserts actions that achieve missing
conditions at once (means-ends analysis: A. Newell, H. A. Simon: GPS, a program that simulates human
thought, 1963). The world's own steps decide the result. So a trace that reaches the goal is a plan
under the world's timing, whatever the old plan's timing was. It need not be short.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from math import inf

from robotouille.planning.errands import Errand, ErrandList, PlanTrace, TileMap
from robotouille.planning.plan import Joint
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.world import State, World

MAX_DETOURS = 16
"""Maximum number of inserted actions."""

MAX_STEPS = 20
"""Maximum number of steps per errand and per detour. The delay factor multiplies it."""


class PlanRepair:
    """Repairer of plans for one world."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._floor = TileMap(world) if TileMap.is_walked(world) else None

    def repair(self, plan: ErrandList, state: State) -> PlanTrace | None:
        """Return a trace from a state to the goal that follows a plan's errands, or None.

        None does not prove that the goal is unreachable.
        """
        # First continue the plan at the step whose state has most facts in common with this one. If
        # that fails, follow the plan from the beginning.
        nearest = plan.nearest(state.facts)
        for step in dict.fromkeys((nearest, 0)):
            course = self._since(plan, step, state)
            if course is not None:
                return course
        return None

    def _since(self, plan: ErrandList, step: int, state: State) -> PlanTrace | None:
        if self._floor is None:
            return None
        known = [self._own(errand) for errand in plan.since(step)]
        pending = _without_detours([e for e in known if not self._is_done(e, state)])
        limit = MAX_STEPS * (len(pending) + MAX_DETOURS) * self._world.task.profile.delay_factor
        return _Repair(self._world, self._floor, pending, state).run(limit)

    def _is_done(self, errand: Errand, state: State) -> bool:
        """Return whether an action's lasting effects are present."""
        if self._floor is None or not errand.action.effects:
            return False
        aims = self._floor.aims(errand.action)
        return bool(aims) and state.facts & aims == aims

    def _own(self, errand: Errand) -> Errand:
        """Return the errand with this world's action. Plans may come from another timing."""
        action = errand.action
        if action.source is self._world:
            return errand
        self._world.admit(action.arguments)
        return replace(errand, action=self._world.action(action.name, *action.arguments))


def _without_detours(errands: Sequence[Errand]) -> list[Errand]:
    """Drop pairs of errands in which a player does something and next undoes it."""
    kept: list[Errand] = []
    for errand in errands:
        touching = [e for e in kept if not e.objects.isdisjoint(errand.objects)]
        last = touching[-1] if touching else None
        if last is not None and _undoes(errand, last) and not _acts_after(kept, last):
            kept.remove(last)
        else:
            kept.append(errand)
    return kept


def _undoes(errand: Errand, last: Errand) -> bool:
    one, other = errand.action, last.action
    is_same = errand.player == last.player and one.touched == other.touched
    return is_same and one.removed ^ other.removed == one.touched != 0


def _acts_after(errands: Sequence[Errand], errand: Errand) -> bool:
    """Return whether a player does something else after an errand."""
    after = errands[max(i for i, e in enumerate(errands) if e is errand) + 1 :]
    return any(e.player == errand.player for e in after)


class _Repair:
    """One repair: the pending errands by their number in the old plan, and the trace so far."""

    def __init__(self, world: World, floor: TileMap, errands: list[Errand], state: State) -> None:
        self._world, self._floor = world, floor
        self._pending = dict(enumerate(errands))
        self._objects = {number: errand.objects for number, errand in self._pending.items()}
        self._queues: dict[str, list[int]] = {player: [] for player in world.players}
        for number, errand in self._pending.items():
            self._queues[errand.player].append(number)
        self._states = [state]
        self._joints: list[Joint] = []
        self._detours = 0

    def run(self, limit: int) -> PlanTrace | None:
        while not (state := self._states[-1]).goal_reached:
            joint = self._joint(state)
            after = self._world.step(state, joint).state
            if joint or after != state:
                self._joints.append(joint)
                self._states.append(after)
            elif not self._unblock(state):
                return None
            if len(self._joints) > limit or self._detours > MAX_DETOURS:
                return None
        return PlanTrace(tuple(self._joints), tuple(self._states))

    def _joint(self, state: State) -> Joint:
        """Return the joint action of a step."""
        facts, joint = state.facts, []
        # A player whose action is impossible is asked again after every other action, which may
        # have made it possible.
        waiting = [p for p in self._world.players if not state.timers.busy_steps(p)]
        again = True
        while again and waiting:
            again = False
            heads = {player: self._head(player, facts) for player in waiting}
            for player in sorted(waiting, key=heads.__getitem__):
                action = self._choice(player, facts)
                if action is not None:
                    joint.append(action)
                    facts = (facts | action.touched) ^ action.removed
                    waiting.remove(player)
                    again = True
        return tuple(joint)

    def _head(self, player: str, facts: int) -> float:
        """Return the number of a player's next errand, or infinity.

        Errands whose effect is present are dropped.
        """
        queue = self._queues[player]
        while queue:
            aims = self._floor.aims(self._pending[queue[0]].action)
            if not aims or facts & aims != aims:
                return queue[0]
            self._drop(queue[0])
        return inf

    def _add(self, errand: Errand) -> None:
        """Insert an errand before all others."""
        number = min(self._pending, default=0) - 1
        self._pending[number], self._objects[number] = errand, errand.objects
        insort(self._queues[errand.player], number)

    def _drop(self, number: int) -> Errand:
        errand = self._pending.pop(number)
        self._queues[errand.player].remove(number)
        return errand

    def _choice(self, player: str, facts: int) -> GroundAction | None:
        """Return the next errand's action or a walk to it; None if neither is possible now."""
        while (number := self._head(player, facts)) != inf:
            number = int(number)
            errand = self._pending[number]
            if facts & errand.needs != errand.needs or self._is_early(number):
                return self._walk_ahead(number, facts)
            for action in self._floor.variants(errand.action):
                if not self._floor.lacks(action, facts):
                    return self._go(number, action, facts)
            if not self._put_in(number, facts):
                self._drop(number)
        return None

    def _go(self, number: int, action: GroundAction, facts: int) -> GroundAction | None:
        """Return an action or the walk to it, if possible."""
        if facts & action.tested == action.required:
            self._drop(number)
            return action
        return self._walk(action, facts)

    def _walk(self, action: GroundAction, facts: int) -> GroundAction | None:
        player, there = str(action.player), self._floor.station_of(action)
        here = self._floor.place(player, facts)
        if there is None or there == here:
            return None
        walk = self._floor.walk(player, here, there)
        return walk if facts & walk.tested == walk.required else None

    def _walk_ahead(self, number: int, facts: int) -> GroundAction | None:
        """Return the walk to a later errand, unless another player needs its station first."""
        action = self._pending[number].action
        there = self._floor.station_of(action)
        if any(there in self._objects[earlier] for earlier in self._earlier(number)):
            return None
        return self._walk(action, facts)

    def _earlier(self, number: int) -> Iterator[int]:
        """Yield the errands of other players that come before an errand."""
        own = self._pending[number].player
        for player, queue in self._queues.items():
            if player != own:
                yield from takewhile(number.__gt__, queue)

    def _is_early(self, number: int) -> bool:
        """Return whether other players have earlier errands about the same objects."""
        about = self._objects[number]
        return any(not about.isdisjoint(self._objects[n]) for n in self._earlier(number))

    # Deviations from the plan

    def _put_in(self, number: int, facts: int) -> bool:
        """Insert an action that makes an errand possible. Return False if there is none."""
        errand = self._pending[number]
        variants = self._floor.variants(errand.action)
        lacking = min((self._floor.lacks(a, facts) for a in variants), key=int.bit_count)
        others = [p for p in self._world.players if p != errand.player]
        for bit in bits_of(lacking):
            for player in (errand.player, *others):
                found = min(self._achievers(player, 1 << bit, facts), default=None)
                if found is not None and self._detours <= MAX_DETOURS:
                    self._detours += 1
                    self._add(Errand(player, found[-1]))
                    return True
        return False

    def _achievers(
        self, player: str, bit: int, facts: int
    ) -> Iterator[tuple[int, bool, bool, tuple[int, ...], GroundAction]]:
        """Yield actions of a player that change a fact at once, the least intrusive ones first."""
        here, none = self._floor.place(player, facts), self._world.timers.none
        used = frozenset[str]().union(*(self._objects[number] for number in self._pending))
        for station in self._floor.stations:
            there = self._floor.moved(player, facts, station)
            for action in self._world.actions(State(self._world, there, none), player):
                after = (there | action.touched) ^ action.removed
                is_walk = action.destination is not None
                if is_walk or action.effects or not (after ^ facts) & bit:
                    continue
                cost = (len(action.arguments), station in used, station != here)
                yield (*cost, action.key, action)

    def _unblock(self, state: State) -> bool:
        """Resolve a deadlock: stop waiting for facts, step aside, or drop an errand."""
        if not self._pending:
            return False
        self._detours += 1
        number = min(self._pending)
        errand = self._pending[number]
        if state.facts & errand.needs != errand.needs:
            self._pending[number] = replace(errand, needs=0)
        elif not self._step_aside(errand, state):
            self._drop(number)
        return True

    def _step_aside(self, errand: Errand, state: State) -> bool:
        """Move a player who blocks the station of an errand. Return False if nobody does."""
        floor, facts = self._floor, state.facts
        ready = [a for a in floor.variants(errand.action) if not floor.lacks(a, facts)]
        there = floor.station_of(ready[0]) if ready else None
        for player in self._world.players:
            if player == errand.player or floor.place(player, facts) != there:
                continue
            for station in floor.stations:
                walk = floor.walk(player, str(there), station)
                if facts & walk.tested == walk.required:
                    self._joints.append((walk,))
                    self._states.append(self._world.step(state, (walk,)).state)
                    return True
        return False
