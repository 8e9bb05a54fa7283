"""The same steps in JAX: tables of equal rows, steps of one copy as pure functions, the batch."""
