"""What the owner of a viewer has chosen: which seat, which span, which pages are open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

__all__ = ["JobProgress", "ViewerState"]

MESSAGE_SECONDS = 8.0


@dataclass(slots=True)
class JobProgress:
    """How far something is that is done beside the window, in words; `done` is its share, from 0 to
    1, None where nobody knows. `stop` gives it up."""

    words: str
    stop: Callable[[], None]
    done: float | None = None


@dataclass(slots=True)
class ViewerState:
    """`followed` is a player, `first` and `last` are the steps of the span to export (None: not
    marked), `log` and `help` say what is open over the window, `jobs` what is being done beside it,
    by what it is about."""

    now: Callable[[], float]
    followed: str | None = None
    first: int | None = None
    last: int | None = None
    log: bool = False
    help: bool = False
    jobs: dict[str, JobProgress] = field(default_factory=dict)
    _message: str = field(default="", repr=False)
    _until: float = field(default=0.0, repr=False)

    @property
    def message(self) -> str:
        """The latest message, while it is new."""
        return self._message if self.now() < self._until else ""

    def tell(self, message: str) -> None:
        """Show a message for a while."""
        self._message, self._until = message, self.now() + MESSAGE_SECONDS

    def span(self, length: int) -> tuple[int, int]:
        """The marked span: from its first to its last step, in this order."""
        first = 0 if self.first is None else min(self.first, length)
        last = length if self.last is None else min(self.last, length)
        return min(first, last), max(first, last)
