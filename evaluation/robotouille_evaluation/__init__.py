"""The benchmark: packs of tasks, agents, runs, metrics and reports."""
