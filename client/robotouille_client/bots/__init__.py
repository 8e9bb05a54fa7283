"""Bots on top of the client library."""

from robotouille_client.bots.player import play
from robotouille.planning.policies import Policy, RandomPolicy

__all__ = ["Policy", "RandomPolicy", "play"]
