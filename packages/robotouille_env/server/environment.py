"""One session of the server: a text game, and the tasks that a client may choose from."""

from __future__ import annotations

import itertools
import threading
from functools import lru_cache
from typing import Any
from uuid import uuid4

from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import EnvironmentMetadata

from robotouille.errors import RobotouilleError, WrongArgumentError, did_you_mean
from robotouille.installation import VERSION
from robotouille_env.models import RobotouilleAction, RobotouilleObservation, RobotouilleState
from robotouille_evaluation.text_games import (
    DATASETS,
    SPLITS,
    GameOptions,
    Instances,
    TextGame,
    load_instance,
)

SPLIT_NAMES = tuple(f"{dataset}/{split}" for dataset in DATASETS for split in SPLITS)
DEFAULT_SPLIT = SPLIT_NAMES[1]
ENDLESS = 1_000_000
"""Number of tasks that is reported for an endless split."""
MAX_LISTED = 1000
"""Most tasks in one answer."""
BUSY_SECONDS = 60.0
"""Longest time for which a reset waits for others."""
_one_at_a_time = threading.Lock()
"""Held while an instance is made, which can take seconds: with many threads at work, the server
would answer nobody."""


class RobotouilleEnvironment(
    Environment[RobotouilleAction, RobotouilleObservation, RobotouilleState]
):
    """Game of one session.

    Args:
        options: Options of all games. They are the operator's: an agent can be any Python code.
    """

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self, options: GameOptions | None = None) -> None:
        super().__init__()
        self._options = options or GameOptions()
        self._game: TextGame | None = None
        self._episode = ""
        self._count = 0

    def reset(
        self,
        seed: int | None = None,
        episode_id: str | None = None,
        task: str | None = None,
        split: str | None = None,
        index: int | None = None,
        seats: int | None = None,
        **others: Any,
    ) -> RobotouilleObservation:
        """Begin a game.

        Args:
            seed: With a task, a new instance of it; otherwise a task of the split, in turn.
            task: Name of a shipped task or instance.
            split: One of `list_splits`.
            index: Number in the split, from 0.
            seats: Number of players; by default, the task's.

        Raises:
            RobotouilleError: An argument is invalid, or the instance does not exist.
        """
        if others:
            raise WrongArgumentError(
                f"unknown argument {min(others)!r}; expected task, split, index, seed or seats"
            )
        name = _chosen(
            _text("task", task), _text("split", split), _number("index", index),
            _number("seed", seed),
        )  # fmt: skip
        game = _new_game(name, _number("seats", seats), self._options)
        self.close()
        self._game = game
        self._episode = _text("episode_id", episode_id) or str(uuid4())
        self._count = 0
        observation = self._observation(0.0)
        request = self._game.request
        sent = request.messages[:-1] if request is not None else ()
        observation.prompt = [{"role": each.role, "content": each.content} for each in sent]
        return observation

    def step(
        self, action: RobotouilleAction, timeout_s: float | None = None, **others: Any
    ) -> RobotouilleObservation:
        """Continue with a model's answer.

        Raises:
            WrongArgumentError: No game has begun, or it is over.
        """
        game = self._running()
        reward = game.answer(game.headed(action.message))
        self._count += 1
        return self._observation(reward)

    @property
    def state(self) -> RobotouilleState:
        """State of the session."""
        game = self._game
        if game is None:
            return RobotouilleState()
        return RobotouilleState(
            episode_id=self._episode,
            step_count=self._count,
            instance=game.instance.name,
            players=list(game.world.players),
            score=game.score.as_json(),
        )

    def close(self) -> None:
        """End the game."""
        if self._game is not None:
            self._game.close()

    def get_metadata(self) -> EnvironmentMetadata:
        """Return the description of the environment."""
        return EnvironmentMetadata(
            name="robotouille_env",
            description="Kitchens for one or more players, to plan and cook in as few steps as "
            "possible. Rewards measure progress; they add up to 1 at the goal.",
            version=VERSION,
        )

    def list_splits(self) -> list[str]:
        """Return the names of the splits."""
        return list(SPLIT_NAMES)

    def num_tasks(self, split: str) -> int:
        """Return the number of tasks of a split."""
        found = _instances(split)
        return ENDLESS if found.endless else len(found)

    def get_task(self, split: str, index: int) -> dict[str, Any]:
        """Return a task. Raise IndexError if the split has no such task."""
        return _entry(split, _instances(split), index)

    def list_tasks(self, split: str) -> list[dict[str, Any]]:
        """Return the first tasks of a split."""
        return self.get_task_range(split)

    def get_task_range(
        self, split: str, start: int | None = None, stop: int | None = None
    ) -> list[dict[str, Any]]:
        """Return the tasks from `start` to before `stop`, at most `MAX_LISTED`."""
        found, numbers = _instances(split), range(self.num_tasks(split))[start:stop]
        return [_entry(split, found, number) for number in itertools.islice(numbers, MAX_LISTED)]

    def _running(self) -> TextGame:
        if self._game is None:
            raise WrongArgumentError("no game has begun; send reset first")
        return self._game

    def _observation(self, reward: float) -> RobotouilleObservation:
        game = self._running()
        over = game.request is None
        return RobotouilleObservation(
            text=game.text,
            legal_actions=list(game.legal),
            feedback=game.feedback,
            player=game.player,
            score=game.score.as_json() if over else {},
            reward=reward,
            done=over,
        )


def _new_game(name: str, seats: int | None, options: GameOptions) -> TextGame:
    if not _one_at_a_time.acquire(timeout=BUSY_SECONDS):
        raise RobotouilleError("too many games are being made; try again later")
    try:
        return TextGame(load_instance(name, seats), options)
    finally:
        _one_at_a_time.release()


def _chosen(task: str | None, split: str | None, index: int | None, seed: int | None) -> str:
    """Return the name of the instance that a client asks for."""
    if task is not None:
        if split is not None or index is not None:
            raise WrongArgumentError("name a task, or a split with an index, but not both")
        return task if seed is None else f"{task}#{seed}"
    found = _instances(split if split is not None else DEFAULT_SPLIT)
    number = index if index is not None else seed or 0
    if index is None and not found.endless:
        number %= len(found)
    try:
        return found.name(number)
    except IndexError as error:
        raise WrongArgumentError(str(error)) from None


# OpenEnv calls this on its event loop, and all instances of a data set take a while to list.
@lru_cache(maxsize=len(SPLIT_NAMES))
def _instances(split: str) -> Instances:
    if split not in SPLIT_NAMES:
        near = did_you_mean(split, SPLIT_NAMES) or f"; expected one of {', '.join(SPLIT_NAMES)}"
        raise WrongArgumentError(f"unknown split {split[:80]!r}{near}")
    dataset, _, name = split.partition("/")
    return Instances(dataset, name)


def _entry(split: str, found: Instances, index: int) -> dict[str, Any]:
    return {"id": found.name(index), "index": index, "split": split}


def _text(what: str, found: object) -> str | None:
    if found is not None and not isinstance(found, str):
        raise WrongArgumentError(f"{what}: expected a text, found {str(found)[:80]!r}")
    return found


def _number(what: str, found: object) -> int | None:
    if found is not None and (not isinstance(found, int) or isinstance(found, bool) or found < 0):
        raise WrongArgumentError(f"{what}: expected an integer from 0, found {str(found)[:80]!r}")
    return found
