"""Strategies ask; here they are answered."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Generator
from typing import TypeVar

from robotouille_evaluation.agents.proposal import ContextOverflow
from robotouille_evaluation.models import Completion, ModelRequest

__all__ = ["Complete", "answer_all"]

R = TypeVar("R")

Complete = Callable[[ModelRequest], Awaitable[Completion]]
"""Asks a model. Raises ContextOverflow, or ModelError."""


async def answer_all(asking: Generator[ModelRequest, Completion, R], complete: Complete) -> R:
    """Answer what a generator asks until it returns."""
    try:
        request = next(asking)
        while True:
            try:
                completion = await complete(request)
            except ContextOverflow as error:
                request = asking.throw(error)
            else:
                request = asking.send(completion)
    except StopIteration as stop:
        result: R = stop.value
        return result
