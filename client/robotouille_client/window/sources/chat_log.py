"""What was said, announced and refused lately."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from robotouille.planning.policies.team_talk import announced_version
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille_client.window.view import NEWS, Bubble

__all__ = ["ChatLog"]

BUBBLE_SECONDS = 3.0
CHAT_LINES = 6
NOTICE_SECONDS = 6.0
READING_SECONDS = 0.06
"""For how much longer an announcement is shown for each of its letters."""


class ChatLog:
    """Keeps words for as long as they are to be seen."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._bubbles: list[tuple[float, Bubble]] = []
        self._lines: deque[tuple[str, str]] = deque(maxlen=CHAT_LINES)
        self._notice = ""
        self._notice_until = 0.0

    def rejected(
        self, player: str, unmet: Sequence[Unmet], told: Callable[[], str] | None = None
    ) -> None:
        """A player's action was rejected, for reasons or what is `told` in their place; no word of
        those that a later one has replaced."""
        if all(each.kind is not UnmetKind.SUPERSEDED for each in unmet):
            words = told() if told else str(unmet[0]) if unmet else ""
            self._add(Bubble.rejection(player, words))

    def said(self, name: str, player: str, text: str) -> None:
        """Words of somebody, but for what bots only have for one another."""
        if announced_version(text) is not None:
            return
        self._lines.append((name, text))
        if player:
            self._add(Bubble(player, text, "chat"))

    def happened(self, text: str) -> None:
        """Something that nobody says: who comes and goes."""
        self._lines.append((NEWS, text))

    def announced(self, text: str) -> None:
        """Words of the operator: in the chat under no name, and as a notice for a while."""
        self._lines.append(("", text))
        self._notify(text)

    def befell(self, text: str) -> None:
        """Something that happened to the game: among the news, and as a notice for a while."""
        self._lines.append((NEWS, text))
        self._notify(text)

    def _notify(self, text: str) -> None:
        self._notice = text
        self._notice_until = self._now() + NOTICE_SECONDS + READING_SECONDS * len(text)

    def _add(self, bubble: Bubble) -> None:
        kept = [(t, b) for t, b in self._bubbles if b.player != bubble.player]
        self._bubbles = [*kept, (self._now(), bubble)]

    @property
    def bubbles(self) -> tuple[Bubble, ...]:
        now = self._now()
        return tuple(b for t, b in self._bubbles if now - t < BUBBLE_SECONDS)

    @property
    def lines(self) -> tuple[tuple[str, str], ...]:
        return tuple(self._lines)

    @property
    def notice(self) -> str:
        """The last announcement, while it is new."""
        return self._notice if self._now() < self._notice_until else ""
