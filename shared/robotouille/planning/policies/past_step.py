"""A step that has passed, as a team sees it."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from robotouille.planning.policies.script import Did, does_something
from robotouille.world.world import State

__all__ = ["PastStep"]


class PastStep(NamedTuple):
    """Its number, the state after it, and what everybody did in it."""

    step: int
    state: State
    did: Did

    def has_acted(self, team: Collection[str]) -> bool:
        """Whether somebody of the team has done something."""
        return any(p in team and ok and does_something(action) for p, action, ok in self.did)

    def is_meddling(self, team: Collection[str]) -> bool:
        """Whether others have done something, walks apart."""
        return any(
            p not in team and ok and action.destination is None
            for p, action, ok in self.did
            if does_something(action)
        )

    def is_running(self, team: Collection[str]) -> bool:
        """Whether time alone will bring something: a walk of the team ends, a patty is done."""
        if any(player in team for player, _ in self.state.timers.busy):
            return True
        return any(row.timed and row.running for row in self.state.progress())
