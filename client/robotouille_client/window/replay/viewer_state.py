"""What the owner of a viewer has chosen: which seat, which span, which pages are open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

__all__ = ["ViewerState"]

MESSAGE_SECONDS = 6.0


@dataclass(slots=True)
class ViewerState:
    """`followed` is a player, `first` and `last` are the steps of the span to export (None: not
    marked), `log` and `help` say what is open over the window."""

    now: Callable[[], float]
    followed: str | None = None
    first: int | None = None
    last: int | None = None
    log: bool = False
    help: bool = False
    busy: str = ""
    """What is being done beside the window, in words."""
    _message: str = field(default="", repr=False)
    _until: float = field(default=0.0, repr=False)

    @property
    def message(self) -> str:
        """The latest message while it is new, else what is being done at present."""
        return self._message if self.now() < self._until else self.busy

    def tell(self, message: str) -> None:
        """Show a message for a while."""
        self._message, self._until = message, self.now() + MESSAGE_SECONDS

    def span(self, length: int) -> tuple[int, int]:
        """The marked span: from its first to its last step, in this order."""
        first = 0 if self.first is None else min(self.first, length)
        last = length if self.last is None else min(self.last, length)
        return min(first, last), max(first, last)
