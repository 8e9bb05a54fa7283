"""Numbers of slots for created objects, which worlds, environments and batches take as `slots`."""

from __future__ import annotations

from collections.abc import Mapping
from operator import index

from robotouille.errors import WrongArgumentError


def slot_counts(slots: Mapping[str, int] | None) -> tuple[tuple[str, int], ...]:
    """Return the numbers of slots by kind, in order.

    Raises:
        WrongArgumentError: They are not numbers above 0 by kind.
    """
    try:
        counts = tuple(sorted((str(kind), index(size)) for kind, size in (slots or {}).items()))
    except (AttributeError, TypeError):
        raise WrongArgumentError(
            f"slots: expected a dictionary of integers by kind, found {slots!r}"
        ) from None
    for kind, size in counts:
        if size < 1:
            raise WrongArgumentError(f"slots: expected 1 or more for {kind!r}, found {size}")
    return counts
