"""What steps are given and come to, of one episode and of many; what is wrong with actions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.errors import RobotouilleError, WrongArgumentError

__all__ = ["ActionRows", "Bools", "CopiesTaken", "Taken", "no_such_action", "not_begun"]

ActionRows = npt.NDArray[np.int64]
"""The number of each player's action, a row for each copy."""

Bools = npt.NDArray[np.bool_]


class Taken(NamedTuple):
    """What a step came to: the reward, whether the goal was reached or the budget is used up, and
    which player's action was applied."""

    reward: float
    terminated: bool
    truncated: bool
    valid: tuple[bool, ...]


class CopiesTaken(NamedTuple):
    """What a step came to in each copy: see `Taken`. `valid`: all that was wanted was applied."""

    rewards: npt.NDArray[np.float64]
    terminated: Bools
    truncated: Bools
    valid: Bools


def not_begun() -> RobotouilleError:
    """What is raised before the first reset."""
    return RobotouilleError("reset the environment: no episode has begun")


def no_such_action(player: str, count: int, number: int) -> WrongArgumentError:
    """What is raised where a player has no action of a number."""
    return WrongArgumentError(f"{player} has {count} actions, found number {number}")
