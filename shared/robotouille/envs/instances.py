"""The choice of the instance and the first state of an episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robotouille.domain.task import Task
from robotouille.envs.rules import EnvRules
from robotouille.envs.views import ObservationView
from robotouille.errors import WrongArgumentError
from robotouille.generation.shuffling import shuffled
from robotouille.world.world import State

NUMBERS = 2**32
"""Count of the first states among which the seed of an endless environment draws."""


def first_state(
    rules: EnvRules,
    views: Sequence[ObservationView],
    view: ObservationView,
    random: np.random.Generator,
    options: Mapping[str, Any] | None,
) -> tuple[ObservationView, State]:
    """Return the instance and the first state of an episode.

    Args:
        view: The instance of the last episode.
        random: Random numbers. An endless environment takes one in each call.
        options: Options of `reset`.

    Raises:
        WrongArgumentError: There is no such instance or level, or `options` is not a dictionary.
    """
    if not isinstance(options, Mapping | None):
        raise WrongArgumentError(f"options: expected a dictionary, found {options!r}")
    # Unknown options are ignored, because PettingZoo's test passes some.
    wanted = options or {}
    instance, level = wanted.get("instance"), wanted.get("level")
    if rules.levels:
        view = _at_level(views, view, level)
    elif level is not None:
        raise WrongArgumentError("level: the environment was made without levels")
    if rules.endless:
        drawn = int(random.integers(NUMBERS))
        return view, shuffled(view.world, _number(drawn if instance is None else instance))
    if instance is not None:
        view = _named(views, instance)
    elif len(views) > 1 and not rules.levels:
        view = views[int(random.integers(len(views)))]
    return view, view.world.initial


def _at_level(
    views: Sequence[ObservationView], view: ObservationView, level: object
) -> ObservationView:
    if level is None:
        return view
    if isinstance(level, int) and 0 <= level < len(views):
        return views[level]
    raise WrongArgumentError(f"level: expected 0 to {len(views) - 1}, found {level!r}")


def _number(number: object) -> int:
    if isinstance(number, int) and 0 <= number < NUMBERS:
        return number
    raise WrongArgumentError(f"instance: expected 0 to {NUMBERS - 1}, found {number!r}")


def _named(views: Sequence[ObservationView], wanted: object) -> ObservationView:
    """Return an instance by task, name or number."""
    for number, view in enumerate(views):
        task = view.world.task
        if wanted in (number, task.name) or (isinstance(wanted, Task) and wanted == task):
            return view
    names = ", ".join(view.world.task.name for view in views)
    raise WrongArgumentError(f"instance: expected one of {names}, found {wanted!r}")
