"""Variants of the benchmark, and what happens in them behind the agent's back."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import Literal

from robotouille import State, World
from robotouille.episode.episode_state import Undone, nothing_undone
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.objects import Atom

__all__ = ["PROBABILITY", "Reverting", "Variant", "chance"]

Variant = Literal["", "stochastic", "delay-free"]
"""As it is; a cut item reverts; nothing has to be waited for (`packs.delay_free`)."""

CUT = "iscut"


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

    def __call__(self, state: State) -> Sequence[Atom]:
        """What is undone in a state, if anything is."""
        if self._done or self._rng.random() >= self._probability:
            return ()
        found = next(self._holding(state), None)
        self._done = found is not None
        return () if found is None else (found,)

    def _holding(self, state: State) -> Iterator[Atom]:
        for number, atom in enumerate(state.world.table.atoms):
            if atom[0] == self._predicate and state.facts >> number & 1:
                yield atom


def chance(variant: Variant, world: World, seed: str) -> Undone:
    """What chance takes back in an episode of a variant.

    Args:
        seed: Decides it; the same for all agents, so that they meet with the same.

    Raises:
        RobotouilleError: Nothing can be cut in this world.
    """
    if variant != "stochastic":
        return nothing_undone
    if CUT not in world.table.fluents:
        raise RobotouilleError(f"{world.task.name}: its domain has no {CUT!r} that could revert")
    return Reverting(CUT, random.Random(seed))
