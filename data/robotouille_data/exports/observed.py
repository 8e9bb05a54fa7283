"""Observations of players: of the whole kitchen, or with limited sight of a part of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robotouille.world.sight import Seen, Sight, seen_by
from robotouille.world.world import State


@dataclass(frozen=True)
class Observed:
    """A state as a player saw it.

    Args:
        sight: Limits of the player's sight; None if the player saw everything.
    """

    state: State
    player: str
    sight: Sight | None

    @cached_property
    def _seen(self) -> Seen | None:
        return None if self.sight is None else seen_by(self.state, self.player, self.sight)

    def text(self) -> str:
        """Return the observation in words."""
        seen = self._seen
        return self.state.text_view(self.player) if seen is None else seen.text_view(self.player)

    def vector(self) -> Any:
        """Return the observation as numbers; see `State.vector`."""
        return (self.state if self._seen is None else self._seen.state).vector()

    def mask(self) -> Any:
        """Return the valid actions, for all that the player saw; see `State.mask`."""
        mask = self.state.mask(self.player)
        if self._seen is None:
            return mask
        seeming = np.zeros_like(mask)
        seeming[[self.state.action_number(a, self.player) for a in self._seen.actions]] = True
        return seeming
