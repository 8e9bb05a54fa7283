"""Many copies of one world at once, as arrays, for those who train (batch.md).

`BatchWorld` runs on the processor: compiled with the extra `fast`, and as plain Python, slowly,
with NumPy alone. `JaxBatch` does the same in JAX, on a GPU if there is one: the extra `gpu`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robotouille.errors import MissingExtraError
from robotouille.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from robotouille.batch.batch_world import BatchStep, BatchWorld
    from robotouille.batch.jax_batch import JaxBatch

__all__ = ["BatchStep", "BatchWorld", "JaxBatch"]

_get = lazy_exports(__name__, "robotouille.batch.batch_world", "robotouille.batch.jax_batch")


def __getattr__(name: str) -> Any:
    """Public names are imported when they are first asked for.

    Raises:
        MissingExtraError: The library that they need is not installed.
    """
    try:
        return _get(name)
    except ModuleNotFoundError as error:
        if error.name not in ("numpy", "jax"):
            raise
        extra = "gpu" if error.name == "jax" else "fast"
        raise MissingExtraError(f"robotouille.batch.{name}", extra) from None
