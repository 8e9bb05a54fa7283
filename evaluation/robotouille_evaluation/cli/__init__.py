"""The commands of the benchmark: `robotouille pack …`."""
