"""Counts of the frames of recordings that are read in each turn of the event loop."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robotouille.replay import recording

__all__ = ["count_frames"]


def count_frames(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the frames that are read from now on; return a list that gets a number per turn."""
    loop, counts, check = asyncio.get_running_loop(), [0], recording.check_frame

    def counted(frame: dict[str, Any], number: int) -> None:
        if not counts[-1]:
            loop.call_soon(counts.append, 0)
        counts[-1] += 1
        check(frame, number)

    monkeypatch.setattr(recording, "check_frame", counted)
    return counts
