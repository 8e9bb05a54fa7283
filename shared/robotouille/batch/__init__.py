"""Many copies of one world at once, as arrays, for training (docs/train.md).

`BatchWorld` runs on the CPU: compiled with the extra `fast`, and slowly as plain Python with NumPy
alone. The package `robotouille-jax` does the same in JAX.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robotouille.errors import MissingExtraError
from robotouille.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from robotouille.batch.batch_world import BatchStep, BatchWorld

__all__ = ["BatchStep", "BatchWorld"]

_get = lazy_exports(__name__, "robotouille.batch.batch_world")


def __getattr__(name: str) -> Any:
    """Import a public name on first access.

    Raises:
        MissingExtraError: NumPy is not installed.
    """
    try:
        return _get(name)
    except ModuleNotFoundError as error:
        if error.name != "numpy":
            raise
        raise MissingExtraError(f"robotouille.batch.{name}", "fast") from None
