"""The names by which commands choose bots: kinds and skills, MODULE:NAME and FILE.npz."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from robotouille.errors import RobotouilleError, did_you_mean

TRAINED = ".npz"
"""Ending of the files of trained policies."""

B = TypeVar("B")


def is_own(name: str) -> bool:
    """Return whether a name is that of the user's own class or of a file."""
    return ":" in name or name.endswith(TRAINED)


def bot_named(
    name: str,
    shipped: Mapping[str, Callable[[], B]],
    *,
    trained: Callable[[Path], B],
    own: Callable[[str], B],
    what: str = "bot",
) -> B:
    """Return the bot with a name.

    Args:
        shipped: Makers of the shipped bots, by name.
        trained: Makes a bot from a file of `robotouille-train`.
        own: Makes a bot from MODULE:NAME.
        what: Noun for the error.

    Raises:
        RobotouilleError: The name is unknown, or a maker refuses it.
    """
    if name.endswith(TRAINED):
        return trained(Path(name))
    if ":" in name:
        return own(name)
    if name not in shipped:
        raise RobotouilleError(
            f"unknown {what} {name!r}{did_you_mean(name, shipped)} "
            f"(possible: {', '.join(shipped)}, MODULE:NAME or FILE{TRAINED})"
        )
    return shipped[name]()
