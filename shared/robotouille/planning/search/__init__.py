"""Best-first search in any domain, on the world's own steps: A* with proof, and greedy search."""
