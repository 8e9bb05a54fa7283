"""Planners made for one kind of domain."""
