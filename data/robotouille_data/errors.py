"""What can be wrong with a catalogue; both are told in a line."""

from __future__ import annotations

from robotouille.errors import RobotouilleError

__all__ = ["CatalogueError", "UnavailableError"]


class CatalogueError(RobotouilleError):
    """A catalogue, or a query of it, that cannot be used as it is."""


class UnavailableError(CatalogueError):
    """A database that cannot be used now: gone, full, locked or read-only. It may come back."""
