"""Strategies ask; here they are answered."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Generator, Iterable
from typing import TypeVar

from robotouille_evaluation.agents.proposal import ContextOverflow
from robotouille_evaluation.models import Completion, ModelRequest

__all__ = ["Complete", "all_of", "answer_all"]

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


async def all_of(asking: Iterable[Awaitable[None]]) -> None:
    """Ask at the same time. Where one fails the others are waited for: their answers are paid for,
    and have to be kept and counted.

    Raises what the first of them has raised, in their order.
    """
    ended = await asyncio.gather(*asking, return_exceptions=True)
    for error in ended:
        if error is not None:
            raise error
