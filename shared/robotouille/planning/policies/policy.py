"""Policies, which choose an action in a state: their interface, random ones, and scripts.

A policy has its own copy of the world. It is synchronous and keeps all its memory itself.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from itertools import takewhile
from typing import NamedTuple, Protocol, runtime_checkable

from robotouille.planning.plan import Plan
from robotouille.planning.policies.standing import standing_at, walk_to
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Signal
from robotouille.world.world import State, World

Did = Sequence[tuple[str, GroundAction, bool]]
"""The actions of a step: player, action, and whether it was applied."""


class Policy(Protocol):
    """Interface of objects that choose the actions of one seat."""

    def act(self, state: State) -> GroundAction | None:
        """Return the action to take in a state, or None to do nothing in this step."""

    def observe(self, did: Did) -> None:
        """Process all actions of a step. Called once for each step, before `act`."""


class Speech(NamedTuple):
    """Something that a policy says: a chat message, a signal, or a text for bots alone.

    A signal needs no text.
    """

    text: str = ""
    signal: Signal | None = None
    to_bots: bool = False


@runtime_checkable
class TeamPolicy(Policy, Protocol):
    """A policy that reacts to the other participants and to chat messages, and sends some itself.

    `anticipating` is true if the last action counts on another seat's action in the same step.
    """

    anticipating: bool

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        """Set the kind of participant in each seat, and the clock. Called on every change.

        Kinds are `bot`, `human`, `model`, `absent` and others, or empty for a free seat.
        """

    def hear(self, player: str, speech: Speech) -> None:
        """Process a chat message, a signal with its sentence, or a text for bots.

        The policy's own are included: all bots of a team must hear the same in the same order.
        """

    def speak(self) -> list[Speech]:
        """Return what the policy says since the last call."""


def waits(policy: Policy) -> bool:
    """Return whether a policy that chose to do nothing waits for a place or a participant.

    Policies without a `waiting` attribute never wait.
    """
    return bool(getattr(policy, "waiting", False))


def think(policy: Policy, state: State) -> None:
    """Let a policy plan in a state in which it may not act, if it has a `think` method."""
    plan = getattr(policy, "think", None)
    if plan is not None:
        plan(state)


class RandomPolicy:
    """Policy that chooses random valid actions. Equal seeds give equal choices."""

    def __init__(self, player: str, seed: int = 0) -> None:
        self._player = player
        self._random = random.Random(f"{seed}:{player}")

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        actions = state.actions(self._player)
        return self._random.choice(actions) if actions else None


class _Row(NamedTuple):
    """An action of one seat: its step, its position in the step, and its dependencies.

    `needs` maps other seats to the number of their actions that have to come before. `at` is the
    station at which the plan expects the seat before the action.
    """

    step: int
    place: int
    action: GroundAction
    needs: Mapping[str, int]
    at: str | None


class Script:
    """One seat's part of a plan, under any clock and timing profile, as a partial order of actions.

    An action waits for the earlier actions of other seats that concern the same objects, and for
    effects that end before it in the plan: a patty is not picked up before it is cooked. A player
    who made way for someone returns as soon as there is something to do there.

    Args:
        direct: Replace several walks in a row by one walk if possible.
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
        # A plan states steps, but steps take longer in other timing profiles and when others
        # interfere. So only the order of dependent actions is kept, and which effects have ended
        # before each.
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
        """Process all actions of a step.

        Players who deviate from the plan are added to `astray`. Players in `may_walk` and players
        without further actions may walk anywhere.
        """
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
        """Return how many of a seat's next actions an action completes."""
        # Only the destination of walks matters: one walk may replace several.
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
        """True if this seat has no actions left."""
        return self._next(self.player) is None

    def is_finished(self, players: Collection[str]) -> bool:
        """Return whether these seats have no actions left."""
        return all(self._next(player) is None for player in players)

    def coming(self, count: int) -> list[GroundAction]:
        """Return at most `count` next actions of this seat."""
        done = self._done[self.player]
        return [row.action for row in self._rows[self.player][done : done + count]]

    def errand(self) -> list[GroundAction]:
        """Return the actions of this seat up to its second action other than a walk."""
        found, left = [], 2
        for row in self._rows[self.player][self._done[self.player] :]:
            found.append(row.action)
            left -= row.action.destination is None
            if not left:
                break
        return found

    def rest(self, players: Collection[str]) -> list[GroundAction]:
        """Return the remaining actions of some seats in the plan's order."""
        rows = [row for p in players for row in self._rows[p][self._done[p] :]]
        return [row.action for row in sorted(rows, key=lambda row: (row.step, row.place))]

    def shortened(self, state: State) -> Plan | None:
        """Return the rest of the plan from a state if all seats act as soon as they can.

        Return None if the rest does not reach the goal.
        """
        script = copy(self)
        script._done, script.astray = dict(self._done), set()
        steps: list[tuple[GroundAction, ...]] = []
        before = None
        while state != before and not state.goal_reached:
            # Actions that rely on another one of the same step come last.
            chosen = sorted(script.joint(state).values(), key=lambda pair: pair[1])
            before, step = state, state.step([action for action, _ in chosen])
            state = step.state
            done = [each.action for each in step.attempts if each.applied]
            script.observe([(action.player or self.player, action, True) for action in done])
            steps.append(tuple(done))
        return Plan(tuple(steps)) if state.goal_reached else None

    def non_move_action(self, player: str) -> GroundAction | None:
        """Return the next action of a seat that is not a walk."""
        row = self._next_non_move(player)
        return None if row is None else row.action

    def waits_for(self, players: Collection[str]) -> bool:
        """Return whether this seat's next walk or next other action waits for some players."""
        non_move_action, row = self._next_non_move(self.player), self._next(self.player)
        return any(
            self._done[p] < each.needs.get(p, 0)
            for each in (non_move_action, row)
            if each is not None
            for p in players
        )

    def _next_non_move(self, player: str) -> _Row | None:
        rows = self._rows[player][self._done[player] :]
        return next((row for row in rows if row.action.destination is None), None)

    def due(self, player: str, state: State, chosen: Collection[str] = ()) -> GroundAction | None:
        """Return a seat's next action if the plan waits for nothing else, valid or not.

        Args:
            chosen: Seats whose next action comes earlier in the same step.
        """
        row = self._next(player)
        if row is None or not self._is_time(row, state, chosen):
            return None
        action = _here(state.world, row.action)
        if action is None:
            return None
        return self._way_back(player, row, state) or self._shortcut(player, state) or action

    def _shortcut(self, player: str, state: State) -> GroundAction | None:
        """Return one walk instead of several."""
        # Each walk on the way may be blocked by a participant, and takes time in real time.
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
        """Return the walk back to where the plan expects a player, or None."""
        if standing_at(state, player) in (None, row.at):
            return None
        non_move_action = self._next_non_move(player)
        if non_move_action is None:
            return walk_to(state, player, row.action.destination)
        walk, action = (
            walk_to(state, player, non_move_action.at),
            _here(state.world, non_move_action.action),
        )
        if walk is None or action is None or not self._is_time(non_move_action, state):
            return None
        facts = (state.facts | walk.touched) ^ walk.removed
        there = State(state.world, facts, state.timers)
        # Walking back too early would block the place again, so the next action has to be possible.
        return walk if state.world.applicable(there, action) else None

    def act(self, state: State) -> GroundAction | None:
        """Return the next action of this seat if it is due and valid, else None."""
        action = self.due(self.player, state)
        if action is None or not state.world.applicable(state, action):
            return None
        return action

    def waits(self, state: State) -> bool:
        """Return whether this seat waits for another player rather than for a running effect."""
        row = self._next(self.player)
        if row is None or running_effects(state) & self._finished[row.step]:
            return False
        return self.act(state) is None

    def joint(self, state: State) -> dict[str, tuple[GroundAction, bool]]:
        """Return all seats' actions of a step in which all of them decide at the same time.

        Each action comes with whether it counts on an earlier action of the same step.
        """
        chosen: dict[str, tuple[GroundAction, bool]] = {}
        now = state
        rows = ((self._next(p), p) for p in self._rows)
        order = [p for _, _, p in sorted((r.step, r.place, p) for r, p in rows if r is not None)]
        # An action can enable another one in the same step, so each chosen action restarts the
        # loop. The order of the plan makes all bots of a team choose the same actions.
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
    """Return whether an action does more than wait."""
    return bool(action.touched or action.effects)


def depend(one: GroundAction, other: GroundAction, *, but: int = 0) -> bool:
    """Return whether the order of two actions matters, apart from the facts `but`."""
    # Two actions commute if neither changes facts that the other one reads or changes.
    reads, other_reads = one.tested | one.reads, other.tested | other.reads
    shared = one.touched & (other_reads | other.touched) | other.touched & reads
    return bool(shared & ~but)


def _here(world: World, action: GroundAction) -> GroundAction | None:
    """Return an action in another copy of the world, or None if its objects do not exist there."""
    if not world.thing_names.issuperset(action.arguments):
        return None
    return world.action(action.name, *action.arguments)


def running_effects(state: State) -> set[str]:
    """Return the delayed and repeated effects that have not ended."""
    return {str(effect) for effect, _ in state.timers.entries}
