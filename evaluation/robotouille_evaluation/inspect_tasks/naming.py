"""What Inspect calls what is registered here."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

__all__ = ["of_distribution"]

P = ParamSpec("P")
R = TypeVar("R")


def of_distribution(function: Callable[P, R]) -> Callable[P, R]:
    """Have a function registered as `robotouille/NAME`.

    Inspect takes the first part from the package that a function says it is of, and finds it again
    by an entry point of that name; what people install, and type, is the distribution's name.
    """
    function.__module__ = "robotouille"
    return function
