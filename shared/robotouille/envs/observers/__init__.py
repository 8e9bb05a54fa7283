"""Observations of agents: a state from an agent's perspective, with the goal (docs/train.md)."""

from robotouille.envs.observers.making import observer_of
from robotouille.envs.observers.observer import Observer

__all__ = ["Observer", "observer_of"]
