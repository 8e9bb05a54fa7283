"""Text games: episodes, instances and scores for libraries that train and evaluate models.

The packages `robotouille-verifiers`, `robotouille_env` (OpenEnv) and `robotouille-textarena` adapt
them.
"""

from robotouille_evaluation.text_games.game import (
    CONVERSATION,
    PARTNERS,
    GameOptions,
    TextGame,
)
from robotouille_evaluation.text_games.instances import (
    DATASETS,
    SPLITS,
    GameInstance,
    Instances,
    Split,
    load_instance,
)
from robotouille_evaluation.text_games.score import GameScore

__all__ = [
    "CONVERSATION",
    "DATASETS",
    "PARTNERS",
    "SPLITS",
    "GameInstance",
    "GameOptions",
    "GameScore",
    "Instances",
    "Split",
    "TextGame",
    "load_instance",
]
