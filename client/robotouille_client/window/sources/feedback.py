"""What is shown of what players say, and of what they could not do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from robotouille.world.people.wording import Wording
from robotouille.world.unmet import Unmet
from robotouille.world.world import State
from robotouille_client.window.sources.blockages import Blockages
from robotouille_client.window.sources.chat_log import ChatLog

__all__ = ["Feedback"]


@dataclass(frozen=True, slots=True)
class Feedback:
    """Has words seen, and takes from them who waits for whom."""

    chat_log: ChatLog
    blockages: Blockages

    def show_refusal(
        self,
        player: str,
        sentence: str,
        unmet: Sequence[Unmet],
        state: State,
        wording: Wording,
    ) -> None:
        """A player's action, as `World.parse` reads it, was refused in a state."""
        told = partial(wording.refusal, sentence, player, unmet, state)
        self.chat_log.rejected(player, unmet, told)
        self.blockages.refused(player, unmet, state)

    def show_speech(
        self, name: str, player: str, text: str, state: State, wording: Wording
    ) -> None:
        """Somebody, by a name, has said something; no `player` where that is no seat."""
        self.chat_log.said(name, player, text)
        self.blockages.said(player, text, state, wording)
