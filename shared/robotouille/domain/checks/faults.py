"""What several checks say in the same words."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.errors import Fault, did_you_mean

__all__ = ["unknown"]


def unknown(path: str, what: str, name: str, valid: Iterable[str]) -> Fault:
    """A name that nothing goes by, with the nearest that something does."""
    return Fault(path, f"unknown {what} {name!r}{did_you_mean(name, valid)}")
