"""Servers made wrong on purpose, to see that somebody notices."""

from __future__ import annotations

import pytest

from robotouille_server.rooms.recordings.journal import Journal

__all__ = ["told_though_not_written"]


def told_though_not_written(patch: pytest.MonkeyPatch) -> None:
    """A room takes no notice when its recording cannot be written."""
    write = Journal.write

    def careless(journal: Journal) -> bool:
        write(journal)
        return True

    patch.setattr(Journal, "write", careless)
