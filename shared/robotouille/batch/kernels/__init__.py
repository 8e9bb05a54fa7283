"""Kernels: what is compiled where the extra `fast` is installed, and plain Python else."""
