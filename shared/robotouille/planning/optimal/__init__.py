"""Shortest plans in any domain, by best-first search on the world's own transition function."""
