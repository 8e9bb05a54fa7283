"""Follow one seat's part of a plan, under any clock and timing profile."""

from __future__ import annotations

from collections.abc import Sequence

from robotouille.planning.plan import Plan
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["Did", "Script"]

Did = Sequence[tuple[str, GroundAction, bool]]
"""The actions of a step: player, action, and whether it was applied."""


class Script:
    """A plan as an order of actions.

    A plan says what happens in which step; elsewhere things take longer. So an action waits for
    all actions of earlier steps of the plan, the other seats' included, and for every effect that
    had run its course by then in the plan (a patty is not picked up before it is cooked).
    """

    def __init__(self, player: str, plan: Plan, start: State) -> None:
        self.player = player
        self.astray: set[str] = set()
        self._finished: list[frozenset[str]] = []
        self._rows: dict[str, list[tuple[int, GroundAction]]] = {
            name: [] for name in start.world.players
        }
        self._done = dict.fromkeys(self._rows, 0)
        self._rehearse(plan, start)

    def _rehearse(self, plan: Plan, state: State) -> None:
        begun = _running(state)
        for step, actions in enumerate(plan):
            running = _running(state)
            self._finished.append(frozenset(begun - running))
            for action in actions:
                self._rows[action.player or self.player].append((step, action))
            state = state.step(list(actions)).state
            begun |= _running(state)

    def observe(self, did: Did) -> None:
        """What everybody did in a step; who does what the plan does not say is `astray`."""
        for player, action, applied in did:
            row = self._next(player)
            if applied and row is not None and str(row[1]) == str(action):
                self._done[player] += 1
            elif applied and str(action.schema.parameters) != "()":
                self.astray.add(player)

    def _next(self, player: str) -> tuple[int, GroundAction] | None:
        rows, done = self._rows[player], self._done[player]
        return rows[done] if done < len(rows) else None

    @property
    def finished(self) -> bool:
        """Whether this seat has nothing left to do."""
        return self._next(self.player) is None

    def waits_for(self) -> list[str]:
        """The seats whose part has to come before this seat's next action."""
        mine = self._next(self.player)
        if mine is None:
            return []
        others = [(p, self._next(p)) for p in self._rows if p != self.player]
        return [p for p, row in others if row is not None and row[0] < mine[0]]

    def act(self, state: State) -> GroundAction | None:
        """The next action of the seat, if it is its time; None to wait."""
        mine = self._next(self.player)
        if mine is None or self.waits_for():
            return None
        step, action = mine
        if _running(state) & self._finished[step]:
            return None
        # The plan may be of another copy of the world, in which more has been created.
        if not state.world.thing_names.issuperset(action.arguments):
            return None
        here = state.world.action(action.name, *action.arguments)
        return here if state.world.applicable(state, here) else None


def _running(state: State) -> set[str]:
    return {str(effect) for effect, _ in state.timers.entries}
