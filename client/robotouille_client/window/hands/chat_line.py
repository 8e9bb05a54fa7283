"""The line of chat that is being typed."""

from __future__ import annotations

__all__ = ["MAX_LENGTH", "ChatLine"]

MAX_LENGTH = 200


class ChatLine:
    """Letters come as text, the rest as keys; `typed` is None while nobody types."""

    def __init__(self) -> None:
        self.typed: str | None = None
        self._swallow = ""

    def open(self, key: str) -> None:
        """Begin a line; the letter of the key that opened it is still to come as text."""
        self.typed = ""
        self._swallow = key if len(key) == 1 else ""

    def text(self, text: str) -> None:
        """Letters were typed."""
        if self.typed is None:
            return
        swallow, self._swallow = self._swallow, ""
        if swallow and text.casefold() == swallow:
            return
        letters = "".join(letter for letter in text if letter.isprintable())
        self.typed = (self.typed + letters)[:MAX_LENGTH]

    def key(self, name: str) -> str:
        """A key was pressed; what is to be said, if that ended the line."""
        self._swallow = ""
        said = ""
        if name == "backspace":
            self.typed = (self.typed or "")[:-1]
        elif name == "escape":
            self.typed = None
        elif name in ("return", "enter"):
            said, self.typed = (self.typed or "").strip(), None
        return said
