"""Pieces of both PDDL encodings: actions, goal, creations and timers over variables."""
