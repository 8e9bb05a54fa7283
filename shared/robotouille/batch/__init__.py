"""Many copies of one world at once, as arrays, for those who train (batch.md).

`BatchWorld` runs on the processor: compiled with the extra `fast`, and as plain Python, slowly,
with NumPy alone. `JaxBatch` does the same in JAX, on a GPU if there is one: the extra `gpu`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.batch.batch_world import BatchStep, BatchWorld
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(__name__, "robotouille.batch.batch_world")

__all__ = ["BatchStep", "BatchWorld"]
