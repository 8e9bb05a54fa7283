"""The names of topics."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ROOT", "Topics"]

ROOT = "robotouille/v1"
"""Before all topics; the number is that of the payloads."""
MAX_TOPIC = 200


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of the server of this name. Episodes have their ids in them, never their codes,
    with which one could join."""

    server: str

    @property
    def presence(self) -> str:
        """Whether the server is there; retained."""
        return f"{ROOT}/{self.server}/presence"

    @property
    def commands(self) -> str:
        """What laboratories ask for."""
        return f"{ROOT}/{self.server}/commands"

    @property
    def answers(self) -> str:
        """What became of it, unless the command names a topic below."""
        return f"{ROOT}/{self.server}/answers"

    def life(self, episode: str) -> str:
        """How an episode begins, pauses and ends."""
        return f"{ROOT}/{self.server}/episodes/{episode}/life"

    def steps(self, episode: str) -> str:
        """Its steps, if somebody asks for them."""
        return f"{ROOT}/{self.server}/episodes/{episode}/steps"

    def response_topic(self, asked: str) -> str:
        """Where to answer: a topic below `answers` that was asked for, and no other, since the
        server may publish what whoever asks may not."""
        below = asked.removeprefix(f"{self.answers}/")
        well_formed = asked.isprintable() and not set(asked) & set("+#")
        if below != asked and below and well_formed and len(asked) <= MAX_TOPIC:
            return asked
        return self.answers
