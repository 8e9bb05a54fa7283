"""Bots on top of the client library."""

from robotouille.planning.policies.policy import Policy, RandomPolicy
from robotouille_client.bots.player import play

__all__ = ["Policy", "RandomPolicy", "play"]
