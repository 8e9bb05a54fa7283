"""The common part of all kinds of observations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from gymnasium import spaces

from robotouille.envs.layout import Layout, Said
from robotouille.envs.observers.sight_of_agents import SightOfAgents
from robotouille.envs.play import Play
from robotouille.envs.views import Mask


class Observer(ABC):
    """Observations of one kind for the agents of an environment."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._sight = SightOfAgents(layout.rules.sight)

    @abstractmethod
    def space(self) -> spaces.Space[Any]:
        """Return the space of observations."""

    @abstractmethod
    def observe(self, play: Play, seat: int | None = None, said: Said = ()) -> Any:
        """Return an observation of a game's state, as an object of its own.

        Args:
            seat: Seat of the agent, or None for an agent that controls all players.
            said: The players' messages, if there are any.
        """

    def observe_all(self, play: Play, said: Said) -> list[Any]:
        """Return the observation of each player's agent, in seat order."""
        return [self.observe(play, seat, said) for seat in range(len(play.players))]

    def masks(self, play: Play) -> tuple[Mask, ...]:
        """Return each player's valid actions, for all that it sees. Do not change them."""
        return self._sight.masks(play)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.layout,)


def order_of(play: Play) -> list[int]:
    """Return the place of each player among the objects."""
    names = [thing.name for thing in play.view.world.encoding.objects]
    return [names.index(player) for player in play.players]
