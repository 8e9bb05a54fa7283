"""Plan repair: a known plan carried out from another state, without a search.

course = PlanRepair(world).repair(errands(course), state)

Who plays seldom leaves a plan for good: somebody has walked elsewhere, holds something, or has done
early what comes later. Then the plan's actions are still good, most of them in their order. What is
done already is left out, walks are made anew, and where something is missing, what brings it about
at once is put in (means-ends analysis: A. Newell, H. A. Simon: GPS, a program that simulates human
thought, 1963). The world's own steps tell what comes of it, so a course that reaches the goal is a
plan under the world's timing, whichever timing the old one was made for. It need not be short.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from math import inf

from robotouille.planning.plan import Joint
from robotouille.planning.repair.errands import Course, Errand, ErrandList, Floor
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.world import State, World

__all__ = ["PlanRepair"]

MAX_DETOURS = 16
"""Actions that are put in, before a repair is given up."""

MAX_STEPS = 20
"""Steps for each errand of the old plan and each detour, times the factor of all delays, before a
repair is given up."""


class PlanRepair:
    """Repairs plans for one world."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._floor = Floor(world) if Floor.is_walked(world) else None

    def repair(self, plan: ErrandList, state: State) -> Course | None:
        """A course from a state to the goal that does what a plan's errands do.

        It goes on from where the plan had most of the state's facts, or if that leads nowhere, from
        the beginning. None if none was found, which says nothing of whether there is one.
        """
        nearest = plan.nearest(state.facts)
        for step in dict.fromkeys((nearest, 0)):
            course = self._since(plan, step, state)
            if course is not None:
                return course
        return None

    def _since(self, plan: ErrandList, step: int, state: State) -> Course | None:
        if self._floor is None:
            return None
        known = [self._own(errand) for errand in plan.since(step)]
        pending = _without_detours([e for e in known if not self._is_done(e, state)])
        limit = MAX_STEPS * (len(pending) + MAX_DETOURS) * self._world.task.profile.delay_factor
        return _Repair(self._world, self._floor, pending, state).run(limit)

    def _is_done(self, errand: Errand, state: State) -> bool:
        """Whether work is done for good."""
        if self._floor is None or not errand.action.effects:
            return False
        aims = self._floor.aims(errand.action)
        return bool(aims) and state.facts & aims == aims

    def _own(self, errand: Errand) -> Errand:
        """The errand in this world's words, if it is from one of another timing."""
        action = errand.action
        if action.source is self._world:
            return errand
        self._world.admit(action.arguments)
        return replace(errand, action=self._world.action(action.name, *action.arguments))


def _without_detours(errands: Sequence[Errand]) -> list[Errand]:
    """Without what a player does and undoes at once, nobody else having to do with it between."""
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
    """Whether a player does something else after an errand."""
    after = errands[max(i for i, e in enumerate(errands) if e is errand) + 1 :]
    return any(e.player == errand.player for e in after)


class _Repair:
    """One repair: what is still to be done, by its place in the old plan, and the course so far."""

    def __init__(self, world: World, floor: Floor, errands: list[Errand], state: State) -> None:
        self._world, self._floor = world, floor
        self._pending = dict(enumerate(errands))
        self._objects = {number: errand.objects for number, errand in self._pending.items()}
        self._queues: dict[str, list[int]] = {player: [] for player in world.players}
        for number, errand in self._pending.items():
            self._queues[errand.player].append(number)
        self._states = [state]
        self._joints: list[Joint] = []
        self._detours = 0

    def run(self, limit: int) -> Course | None:
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
        return Course(tuple(self._joints), tuple(self._states))

    def _joint(self, state: State) -> Joint:
        """What all do in a step, one after the other; who is in the others' way is asked again."""
        facts, joint = state.facts, []
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
        """The number of what a player does next, infinite for nothing; what is done already is
        taken from the list."""
        queue = self._queues[player]
        while queue:
            aims = self._floor.aims(self._pending[queue[0]].action)
            if not aims or facts & aims != aims:
                return queue[0]
            self._drop(queue[0])
        return inf

    def _add(self, errand: Errand) -> None:
        """Put an errand before all others."""
        number = min(self._pending, default=0) - 1
        self._pending[number], self._objects[number] = errand, errand.objects
        insort(self._queues[errand.player], number)

    def _drop(self, number: int) -> Errand:
        errand = self._pending.pop(number)
        self._queues[errand.player].remove(number)
        return errand

    def _choice(self, player: str, facts: int) -> GroundAction | None:
        """An errand or a walk to one; None if there is nothing to do, or something to wait for."""
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
        """An action, or the walk to it, if that is possible."""
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
        """The walk to where something will be done, if nobody else has to be there before."""
        action = self._pending[number].action
        there = self._floor.station_of(action)
        if any(there in self._objects[earlier] for earlier in self._earlier(number)):
            return None
        return self._walk(action, facts)

    def _earlier(self, number: int) -> Iterator[int]:
        """What others have to do before."""
        own = self._pending[number].player
        for player, queue in self._queues.items():
            if player != own:
                yield from takewhile(number.__gt__, queue)

    def _is_early(self, number: int) -> bool:
        """Whether others have to do something about the same things before."""
        about = self._objects[number]
        return any(not about.isdisjoint(self._objects[n]) for n in self._earlier(number))

    # What was not planned

    def _put_in(self, number: int, facts: int) -> bool:
        """Put in what makes an errand possible; False if nothing does."""
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
        """Actions of a player that change a fact at once, the least intrusive ones first."""
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
        """Where nothing goes on, give up what is waited for, or step aside, or leave it out."""
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
        """Let somebody go who stands where an errand is to be done; False if nobody does."""
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
