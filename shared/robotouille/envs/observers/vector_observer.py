"""Observations as vectors."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces

from robotouille.envs.egocentric import Places, places
from robotouille.envs.layout import Layout, Said
from robotouille.envs.observers.observer import Observer, order_of
from robotouille.envs.play import Play
from robotouille.envs.rules import Perspective
from robotouille.envs.views import ObservationView, Vector


class VectorObserver(Observer):
    """Observer of states as vectors, whose numbers `Layout.columns` names."""

    def __init__(self, layout: Layout) -> None:
        super().__init__(layout)
        rules, self._identity = layout.rules, layout.perspective is Perspective.IDENTITY
        self._limited = rules.sight is not None or layout.egocentric
        self._extended = rules.sight is not None or rules.goal or rules.tokens > 0
        self._plain = not (self._limited or self._extended or self._identity)
        self._places: dict[ObservationView, tuple[Places, ...]] = {}

    def space(self) -> spaces.Box:
        return spaces.Box(-1.0, self.layout.sizes.high, (self._length,), np.float32)

    @cached_property
    def _length(self) -> int:
        return len(self.layout.columns)

    def observe_all(self, play: Play, said: Said) -> list[Any]:
        if not self._identity or self._extended:
            return super().observe_all(play, said)
        # One array for all agents takes less time than one for each.
        seats, size = len(play.players), self.layout.state_size
        vectors = np.empty((seats, self._length), dtype=np.float32)
        vectors[:, :size] = play.arrays.vector
        vectors[:, size:] = self._identities[:seats]
        return list(vectors)

    @cached_property
    def _identities(self) -> Vector:
        return np.eye(len(self.layout.players), dtype=np.float32)

    def observe(self, play: Play, seat: int | None = None, said: Said = ()) -> Vector:
        # A step of the world or the engine takes some microseconds, so the usual case is short.
        if self._plain:
            return play.arrays.vector.copy()
        state = self._state(play, seat) if self._limited else play.arrays.vector
        vector, size = np.zeros(self._length, dtype=np.float32), self.layout.state_size
        vector[:size] = state
        if seat is not None and self._identity:
            vector[size + seat] = 1
        if self._extended:
            more = *self._flags(play, seat), *self._progress(play, seat), *self._signals(seat, said)
            parts = np.concatenate(more)
            vector[-len(parts) :] = parts
        return vector

    def _state(self, play: Play, seat: int | None) -> Vector:
        """Return the part of the state that an agent sees, from its perspective."""
        state = play.arrays.vector
        if self.layout.rules.sight is not None:
            vector = self._sight.visible(play, seat).vector()
            state = np.pad(vector, (0, self.layout.sizes.vector - len(vector)))
        if self.layout.egocentric and seat is not None:
            state = np.append(state, np.float32(0))[self._places_of(play.view)[seat]]
        return state

    def _places_of(self, view: ObservationView) -> tuple[Places, ...]:
        """Return, for each seat, the places in a padded vector of an agent's own columns."""
        found = self._places.get(view)
        if found is None:
            found = self._places[view] = places(view, self.layout.state_size)
        return found

    def _flags(self, play: Play, seat: int | None) -> list[Vector]:
        """Return the objects in sight, if sight is limited."""
        seen = self._sight.things(play, seat, self.layout.objects)
        if seen is None or seat is None:
            return []
        if self.layout.egocentric:
            order = order_of(play)
            seen[order] = [*seen[order[seat:]], *seen[order[:seat]]]
        return [seen]

    def _progress(self, play: Play, seat: int | None) -> list[Vector]:
        """Return which conditions of the goal hold, if that is observed."""
        if not self.layout.rules.goal:
            return []
        visible = self._sight.visible(play, seat)
        progress = np.zeros(self.layout.terms, dtype=np.float32)
        holding = [holds for _, holds in visible.world.goal_terms(visible)]
        progress[: len(holding)] = holding
        return [progress]

    def _signals(self, seat: int | None, said: Said) -> list[Vector]:
        """Return the messages of all players, if agents can send some."""
        layout = self.layout
        if not layout.messages:
            return []
        if layout.egocentric and seat is not None:
            said = [*said[seat:], *said[:seat]]
        spoken = np.zeros((len(layout.players), len(layout.messages)), dtype=np.float32)
        spoken[: len(said)] = layout.spoken(said)
        return [spoken.ravel()]
