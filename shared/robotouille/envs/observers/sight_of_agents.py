"""The part of a game's state that each agent sees."""

from __future__ import annotations

import numpy as np

from robotouille.envs.play import Play
from robotouille.envs.views import Mask, Vector
from robotouille.world.sight import Seen, Sight, seen_by
from robotouille.world.world import State


class SightOfAgents:
    """The parts of one game's states that agents see; without a limit of sight, everything.

    An agent's mask and observation are of the same state, so what it sees is computed once.
    """

    def __init__(self, sight: Sight | None) -> None:
        self._sight = sight
        self._state: State | None = None
        self._known: dict[int, Seen] = {}

    def seen(self, play: Play, seat: int | None) -> Seen | None:
        """Return what an agent sees; None for everything."""
        if self._sight is None or seat is None:
            return None
        if self._state is not play.state:
            self._state = play.state
            self._known.clear()
        if seat not in self._known:
            self._known[seat] = seen_by(play.state, play.players[seat], self._sight)
        return self._known[seat]

    def visible(self, play: Play, seat: int | None) -> State:
        """Return the state, or the part of it that an agent sees."""
        seen = self.seen(play, seat)
        return play.state if seen is None else seen.state

    def masks(self, play: Play) -> tuple[Mask, ...]:
        """Return each player's valid actions, for all that it sees. Do not change them."""
        masks = play.arrays.masks
        if self._sight is None:
            return masks
        return tuple(self._seeming(play, seat, mask) for seat, mask in enumerate(masks))

    def _seeming(self, play: Play, seat: int, mask: Mask) -> Mask:
        """Return the actions that are valid for all that an agent sees."""
        seen = self.seen(play, seat)
        player, found = play.players[seat], np.zeros_like(mask)
        valid = () if seen is None else seen.actions
        found[[play.state.action_number(action, player) for action in valid]] = 1
        return found

    def things(self, play: Play, seat: int | None, length: int) -> Vector | None:
        """Return for each object or slot whether an agent sees it; None if it sees everything.

        Args:
            length: Length of the result. The numbers after those of the objects are 0.
        """
        seen = self.seen(play, seat)
        if seen is None:
            return None
        encoding = play.view.world.encoding
        slots = encoding.slots.filled(play.state.facts)
        found = np.zeros(length, dtype=np.float32)
        for i, thing in enumerate(encoding.objects):
            found[i] = slots.get(thing.name, thing.name) in seen.things
        return found
