"""Observations in words."""

from __future__ import annotations

from gymnasium import spaces

from robotouille.envs.layout import SILENCE, Said
from robotouille.envs.observers.observer import Observer
from robotouille.envs.play import Play
from robotouille.envs.views import text_space


class TextObserver(Observer):
    """Observer of states in words: one text for each player of the agent, and the messages."""

    def space(self) -> spaces.Text:
        return text_space()

    def observe(self, play: Play, seat: int | None = None, said: Said = ()) -> str:
        seats = range(len(play.players)) if seat is None else [seat]
        return "\n\n".join([*(self._text(play, each) for each in seats), *self._heard(play, said)])

    def _text(self, play: Play, seat: int) -> str:
        player, seen = play.players[seat], self._sight.seen(play, seat)
        return play.state.text_view(player) if seen is None else seen.text_view(player)

    def _heard(self, play: Play, said: Said) -> list[str]:
        """Return the messages in words."""
        if not self.layout.messages:
            return []
        lines = [
            f"- {player}: {token}"
            for player, token in zip(play.players, said, strict=True)
            if token != SILENCE
        ]
        return ["\n".join(["Messages of the last step:", *(lines or ["- none"])])]
