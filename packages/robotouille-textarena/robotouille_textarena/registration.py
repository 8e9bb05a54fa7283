"""Names of the games in TextArena's registry."""

from __future__ import annotations

from textarena.envs.registration import ENV_REGISTRY, register_with_versions
from textarena.wrappers import GameMessagesAndCurrentBoardObservationWrapper, LLMObservationWrapper

from robotouille import task_names
from robotouille_evaluation.text_games import DATASETS

NAME = "Robotouille-v0"
ENTRY_POINT = "robotouille_textarena.env:RobotouilleTextEnv"
WRAPPERS = {
    "default": [LLMObservationWrapper],
    "-train": [GameMessagesAndCurrentBoardObservationWrapper],
}


def env_id(task: str) -> str:
    """Return the name of a shipped task's game: `Robotouille-v0-synchronous-01`."""
    dataset, _, file = task.partition("/")
    return f"{NAME}-{dataset}-{file.partition('_')[0]}"


def register_games() -> None:
    """Register a game for each shipped task, and `Robotouille-v0` with the argument `task`."""
    tasks = [name for name in task_names() if name.partition("/")[0] in DATASETS]
    for name, options in ((NAME, {}), *((env_id(task), {"task": task}) for task in tasks)):
        if name not in ENV_REGISTRY:
            register_with_versions(id=name, entry_point=ENTRY_POINT, wrappers=WRAPPERS, **options)
