"""Deliberate server faults that the simulation must detect."""

from __future__ import annotations

import pytest

from robotouille_server.rooms.recording.journal import Journal

__all__ = ["publish_despite_failed_writes"]


def publish_despite_failed_writes(patch: pytest.MonkeyPatch) -> None:
    """Make rooms publish events even if writing the recording fails."""
    write = Journal.write

    def careless(journal: Journal) -> bool:
        write(journal)
        return True

    patch.setattr(Journal, "write", careless)
