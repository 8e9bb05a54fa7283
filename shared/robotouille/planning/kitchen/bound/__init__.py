"""The admissible heuristic: `lower_bound` and the parts of it."""
