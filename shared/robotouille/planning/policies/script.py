"""Follow one seat's part of a plan, under any clock and timing profile."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import takewhile
from typing import NamedTuple

from robotouille.planning.plan import Plan
from robotouille.planning.policies.standing import standing_at, walk_to
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

__all__ = ["Did", "Script", "depend", "does_something", "running_effects"]

Did = Sequence[tuple[str, GroundAction, bool]]
"""The actions of a step: player, action, and whether it was applied."""


class _Row(NamedTuple):
    """An action of one seat: its step of the plan, its place there, and what has to be done before.

    `needs` has the number of actions of other seats, for each on whose actions this one depends.
    `at` is the station at which the plan has the seat stand by then.
    """

    step: int
    place: int
    action: GroundAction
    needs: Mapping[str, int]
    at: str | None


class Script:
    """A plan as an order of actions.

    A plan says what happens in which step; elsewhere things take longer. So an action waits for
    those actions of other seats that come before it in the plan and have to do with the same
    things, and for every effect that had run its course by then (a patty is not picked up before it
    is cooked). Who has made way for somebody goes back to where the plan has them once there is
    something for them to do there.

    Args:
        direct: Where walks come one after the other, walk at once to where the last one leads, if
            that is possible.
    """

    def __init__(self, player: str, plan: Plan, start: State, *, direct: bool = False) -> None:
        self.player = player
        self._direct = direct
        self.astray: set[str] = set()
        self._finished: list[frozenset[str]] = []
        self._rows: dict[str, list[_Row]] = {name: [] for name in start.world.players}
        self._done = dict.fromkeys(self._rows, 0)
        self._rehearse(plan, start)

    def _rehearse(self, plan: Plan, state: State) -> None:
        begun = running_effects(state)
        at = {player: standing_at(state, player) for player in self._rows}
        for step, actions in enumerate(plan):
            running = running_effects(state)
            self._finished.append(frozenset(begun - running))
            for place, action in enumerate(actions):
                player = action.player or self.player
                row = _Row(step, place, action, self._needs(player, action), at[player])
                self._rows[player].append(row)
                at[player] = action.destination or at[player]
            state = state.step(list(actions)).state
            begun |= running_effects(state)

    def _needs(self, player: str, action: GroundAction) -> dict[str, int]:
        needs = {}
        for other, rows in self._rows.items():
            if other == player:
                continue
            for number in range(len(rows), 0, -1):
                if depend(rows[number - 1].action, action):
                    needs[other] = number
                    break
        return needs

    def observe(self, did: Did, may_walk: Collection[str] = ()) -> None:
        """What everybody did in a step; who does what the plan does not say is `astray`. A seat
        with nothing left to do may walk, and so may those in `may_walk`."""
        for player, action, applied in did:
            row = self._next(player)
            done = self._done_by(player, action) if applied else 0
            if done:
                self._done[player] += done
                continue
            walks = action.destination is not None
            stays = row is not None and player not in may_walk
            if applied and does_something(action) and (stays or not walks):
                self.astray.add(player)

    def _done_by(self, player: str, action: GroundAction) -> int:
        """How many of a seat's next actions are done with an action. Of walks it only matters where
        they lead: one may be instead of several."""
        for number, row in enumerate(self._rows[player][self._done[player] :], start=1):
            there = row.action.destination
            if there is not None and there == action.destination:
                return number
            if there is None or action.destination is None:
                return int(number == 1 and str(row.action) == str(action))
        return 0

    def _next(self, player: str) -> _Row | None:
        rows, done = self._rows[player], self._done[player]
        return rows[done] if done < len(rows) else None

    @property
    def finished(self) -> bool:
        """Whether this seat has nothing left to do."""
        return self._next(self.player) is None

    def is_finished(self, players: Collection[str]) -> bool:
        """Whether none of some seats has anything left to do."""
        return all(self._next(player) is None for player in players)

    def coming(self, count: int) -> list[GroundAction]:
        """The next actions of this seat, so many at most."""
        done = self._done[self.player]
        return [row.action for row in self._rows[self.player][done : done + count]]

    def rest(self, players: Collection[str]) -> list[GroundAction]:
        """What some seats have left to do, in the plan's order."""
        rows = [row for p in players for row in self._rows[p][self._done[p] :]]
        return [row.action for row in sorted(rows, key=lambda row: (row.step, row.place))]

    def deed(self, player: str) -> GroundAction | None:
        """The next action of a seat that is more than a walk."""
        row = self._deed(player)
        return None if row is None else row.action

    def waits_for(self, players: Collection[str]) -> bool:
        """Whether the next action of this seat that is more than a walk, or the walk there, waits
        for some others to do something first."""
        deed, row = self._deed(self.player), self._next(self.player)
        return any(
            self._done[p] < each.needs.get(p, 0)
            for each in (deed, row)
            if each is not None
            for p in players
        )

    def _deed(self, player: str) -> _Row | None:
        rows = self._rows[player][self._done[player] :]
        return next((row for row in rows if row.action.destination is None), None)

    def due(self, player: str, state: State, chosen: Collection[str] = ()) -> GroundAction | None:
        """The next action of a seat if the plan waits for nothing else, valid or not.

        Args:
            chosen: The seats whose next action is done before in the same step.
        """
        row = self._next(player)
        if row is None or not self._is_time(row, state, chosen):
            return None
        action = _here(state.world, row.action)
        if action is None:
            return None
        return self._way_back(player, row, state) or self._shortcut(player, state) or action

    def _shortcut(self, player: str, state: State) -> GroundAction | None:
        """One walk instead of several."""
        rows = self._rows[player][self._done[player] :] if self._direct else []
        walks = list(takewhile(lambda row: row.action.destination is not None, rows))
        if len(walks) < 2 or not self._is_time(walks[-1], state):
            return None
        return walk_to(state, player, walks[-1].action.destination)

    def _is_time(self, row: _Row, state: State, chosen: Collection[str] = ()) -> bool:
        if running_effects(state) & self._finished[row.step]:
            return False
        return all(self._done[p] + (p in chosen) >= count for p, count in row.needs.items())

    def _way_back(self, player: str, row: _Row, state: State) -> GroundAction | None:
        """The walk of who stands elsewhere than the plan has them, if there is then something to do
        for them where it leads; None for who stands there."""
        if standing_at(state, player) in (None, row.at):
            return None
        deed = self._deed(player)
        if deed is None:
            return walk_to(state, player, row.action.destination)
        walk, action = walk_to(state, player, deed.at), _here(state.world, deed.action)
        if walk is None or action is None or not self._is_time(deed, state):
            return None
        facts = (state.facts | walk.touched) ^ walk.removed
        there = State(state.world, facts, state.timers)
        return walk if state.world.applicable(there, action) else None

    def act(self, state: State) -> GroundAction | None:
        """The next action of the seat, if it is its time; None to wait."""
        action = self.due(self.player, state)
        if action is None or not state.world.applicable(state, action):
            return None
        return action

    def waits(self, state: State) -> bool:
        """Whether the seat has something left to do that is not possible yet, and no effect that
        runs is the cause: somebody has to come first, or to make room."""
        row = self._next(self.player)
        if row is None or running_effects(state) & self._finished[row.step]:
            return False
        return self.act(state) is None

    def joint(self, state: State) -> dict[str, tuple[GroundAction, bool]]:
        """What all seats do in a step in which all decide at the same time: their actions, in the
        order in which they apply, and whether each counts on one before it in the step."""
        chosen: dict[str, tuple[GroundAction, bool]] = {}
        now = state
        rows = ((self._next(p), p) for p in self._rows)
        order = [p for _, _, p in sorted((r.step, r.place, p) for r, p in rows if r is not None)]
        while True:
            for player in order:
                action = None if player in chosen else self.due(player, state, chosen)
                if action is not None and now.world.applicable(now, action):
                    chosen[player] = (action, self.due(player, state) is None)
                    facts = (now.facts | action.touched) ^ action.removed
                    now = State(now.world, facts, now.timers)
                    break
            else:
                return chosen


def does_something(action: GroundAction) -> bool:
    """Whether an action is more than to wait."""
    return bool(action.touched or action.effects)


def depend(one: GroundAction, other: GroundAction, *, but: int = 0) -> bool:
    """Whether it matters which of two actions comes first, `but` for some facts."""
    reads, other_reads = one.tested | one.reads, other.tested | other.reads
    shared = one.touched & (other_reads | other.touched) | other.touched & reads
    return bool(shared & ~but)


def _here(world: World, action: GroundAction) -> GroundAction | None:
    """An action of a plan in another copy of the world, in which less may have been created."""
    if not world.thing_names.issuperset(action.arguments):
        return None
    return world.action(action.name, *action.arguments)


def running_effects(state: State) -> set[str]:
    """The effects of delayed and repeated actions that are not over."""
    return {str(effect) for effect, _ in state.timers.entries}
