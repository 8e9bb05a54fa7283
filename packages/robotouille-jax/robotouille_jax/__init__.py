"""Batch engine of Robotouille in JAX: `JaxBatch`, for GPUs and for `jax.jit` (docs/train.md)."""

from robotouille_jax.engine import CopyState, CopyStep, JaxEngine
from robotouille_jax.jax_batch import JaxBatch

__all__ = ["CopyState", "CopyStep", "JaxBatch", "JaxEngine"]
