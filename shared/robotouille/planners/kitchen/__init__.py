"""Shortest plans for kitchens, with proof: a compact model, an admissible estimate, A*."""
