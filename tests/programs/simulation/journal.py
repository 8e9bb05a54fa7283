"""Log of all events, as a running digest and optionally as text lines."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

from tests.programs.simulation.frames import Unit
from tests.programs.simulation.loop import EPOCH

__all__ = ["Journal"]


class Journal:
    """Log of events with their virtual times; equal digests mean equal courses."""

    def __init__(self, now: Callable[[], float], *, show: bool = False) -> None:
        self._now = now
        self._show = show
        self._hash = hashlib.blake2b(digest_size=16)
        self.events = 0

    @property
    def digest(self) -> str:
        return self._hash.hexdigest()

    def note(self, what: str, *details: Any) -> None:
        self.events += 1
        parts = [_brief(detail) for detail in details]
        line = f"{self._now() - EPOCH:.6f} {what} {' '.join(parts)}"
        self._hash.update(line.encode())
        if self._show:
            print(line)


def _brief(detail: Any) -> str:
    if isinstance(detail, Unit):
        return f"{detail.kind.value} {len(detail.data)}"
    if hasattr(detail, "model_dump"):
        step = getattr(detail, "step", "")
        return f"{detail.type} {step}"
    return str(detail)
