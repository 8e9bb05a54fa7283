"""Episodes in the batch engine, where it is compiled and can play them as the world does.

Only here is anything of the engine imported: compiling takes memory and time that one player's
environments need not spend.
"""

from __future__ import annotations

from robotouille.envs.rules import EnvRules, Observation, Reward

__all__ = ["engine_plays"]


def engine_plays(rules: EnvRules) -> bool:
    """Whether the engine plays under an environment's rules: it is compiled, and nobody asks for a
    `State` in each step, to read it or for its potential."""
    if rules.observation is not Observation.VECTOR or rules.reward is not Reward.SPARSE:
        return False
    from robotouille import compiling

    return compiling.COMPILED
