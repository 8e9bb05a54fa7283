"""The kitchen: where everything is, how it moves, and what comes out of it."""
