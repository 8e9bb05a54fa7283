"""Random reversals of the stochastic variants: a cut item becomes uncut, once in an episode.

The random numbers never depend on the agent, so all agents meet the same reversals. For generated
instances of the published repository they are the published ones.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator, Mapping, Sequence

from robotouille import State, World
from robotouille.episode.record import RandomReversal, no_reversal
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.objects import Atom
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.published_layouts import generate_layout
from robotouille_evaluation.runs.job_list import EpisodeJob

CUT = "iscut"
PROBABILITIES: Mapping[str, float] = {"stochastic": 0.1, "stochastic-paper": 0.33}
"""Probability of a reversal per step by variant: in the published code, and in the paper's text."""


class SingleReversal:
    """Random reversal that happens once in an episode.

    The first object with the predicate loses it. There is one draw per step until a draw has had
    an effect. A draw without an object to reverse is wasted.

    Args:
        predicate: Name of the predicate.
        rng: Source of the draws.
    """

    def __init__(self, predicate: str, rng: random.Random, probability: float) -> None:
        self._predicate = predicate
        self._rng = rng
        self._probability = probability
        self._done = False

    def __call__(self, state: State) -> Sequence[Atom]:
        """Return the fact to reverse in a state, if any."""
        if self._done or self._rng.random() >= self._probability:
            return ()
        found = next(self._holding(state), None)
        self._done = found is not None
        return () if found is None else (found,)

    def _holding(self, state: State) -> Iterator[Atom]:
        # In the fixed order of the table, so that the choice is the same everywhere.
        for number, atom in enumerate(state.world.table.atoms):
            if atom[0] == self._predicate and state.facts >> number & 1:
                yield atom


def reversal_of(job: EpisodeJob, pack: Pack, world: World) -> RandomReversal:
    """Return the random reversals of a job.

    Raises:
        RobotouilleError: Nothing can be cut in this world.
    """
    probability = PROBABILITIES.get(job.variant)
    if probability is None:
        return no_reversal
    if CUT not in world.table.fluents:
        raise RobotouilleError(f"{world.task.name}: its domain has no {CUT!r} that could revert")
    return SingleReversal(CUT, random_numbers(job, pack), probability)


def random_numbers(job: EpisodeJob, pack: Pack) -> random.Random:
    """Return the random numbers of a job's reversals.

    The published evaluation seeds only the generator of layouts, draws the order of the examples,
    and goes on drawing. All its stochastic experiments have one example. Only the first episode of
    a generated instance repeats that. Default layouts are unseeded there, and a second episode
    would get the same numbers.
    """
    instance = pack.instance(job.instance)
    if not pack.experiments or instance.seed is None or job.seed != 0:
        return random.Random(f"{job.instance}:{job.seed}")
    problem = json.loads(pack.task(instance.task).problem)
    noisy = instance.kind == "noisy"
    rng = generate_layout(problem, instance.seed, noisy=noisy, source=instance.task).rng()
    rng.sample(["example"], 1)  # draws bits, though there is only one order
    return rng
