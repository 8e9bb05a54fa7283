"""Calls from the parts of an object to the object, without a cycle of references."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar
from weakref import ref

P = ParamSpec("P")
T = TypeVar("T")


def weakly(method: Callable[P, T]) -> Callable[P, T | None]:
    """Return a function that calls a bound method, or returns None once its object is gone.

    A room has parts that call it back. With these functions, reference counting frees a closed room
    at once. Otherwise its memory would wait for a full garbage collection, which is rare; see
    `process_limits`.
    """
    # `WeakMethod` is not used, because each of its calls makes a bound method again.
    owner, function = ref(method.__self__), method.__func__  # type: ignore[attr-defined]

    def call(*arguments: P.args, **options: P.kwargs) -> T | None:
        alive = owner()
        if alive is None:
            return None
        result: T = function(alive, *arguments, **options)
        return result

    return call
