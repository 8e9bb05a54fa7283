"""Variants of the benchmark: what happens to a state behind the agent's back."""

from __future__ import annotations

import random

from robotouille import State

__all__ = ["PROBABILITY", "Reverting"]

PROBABILITY = 0.1
"""That of the paper's stochastic environment, in each step."""


class Reverting:
    """Once in an episode something that was done is undone: of the objects of which a predicate
    holds, the first loses it.

    After each step there is one draw, until one has had an effect: a draw that finds nothing to
    undo is followed by others.

    Args:
        predicate: What is undone, by its name in the domain.
        rng: Where the draws come from.
    """

    def __init__(
        self, predicate: str, rng: random.Random, probability: float = PROBABILITY
    ) -> None:
        self._predicate = predicate
        self._rng = rng
        self._probability = probability
        self._done = False

    def __call__(self, state: State) -> State:
        """The state after what happens to it, or the same."""
        if self._done or self._rng.random() >= self._probability:
            return state
        after = self._undone(state)
        self._done = after is not state
        return after

    def _undone(self, state: State) -> State:
        for number, atom in enumerate(state.world.table.atoms):
            if atom[0] == self._predicate and state.facts >> number & 1:
                facts = state.facts & ~(1 << number)
                return state.world.restore(facts, state.timer_rows(), state.timers.busy)
        return state
