"""Episodes in the batch engine, where it is compiled and can play them as the world does.

Only here is anything of the engine imported: compiling takes memory and time that one player's
environments need not spend.
"""

from __future__ import annotations

from robotouille.envs.rules import EnvRules, Observation, Reward

__all__ = ["engine_plays", "is_compiled"]


def is_compiled() -> bool:
    """Whether the engine is compiled; as plain Python it is slower than the world."""
    from robotouille.compiling import COMPILED

    return COMPILED


def engine_plays(rules: EnvRules) -> bool:
    """Whether the engine plays under an environment's rules: it is compiled, and nobody asks for a
    `State` in each step, to read it or for its potential."""
    vectors = rules.observation is Observation.VECTOR
    return vectors and rules.reward is Reward.SPARSE and is_compiled()
