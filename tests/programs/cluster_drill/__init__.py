"""Drills of a cluster: bots play on several nodes while nodes and NATS servers fail.

`python -m tests.programs.cluster_drill` runs them. `cluster` contains the processes, `directory`
the nodes of the episodes as NATS stores them. `stage` runs a drill, `failures` and `restarts` are
the drills, and `throughput` measures what nodes cost. `listeners` contains connections that stay at
their node. Bots, evidence and verdict come from `tests.programs.drill`.
"""
