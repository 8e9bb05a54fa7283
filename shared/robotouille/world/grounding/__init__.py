"""A task's objects, facts, actions, effects and goal, compiled once for all its states."""
