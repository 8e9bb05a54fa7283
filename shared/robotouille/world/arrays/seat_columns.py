"""Names of a vector's numbers as another seat would call them."""

from __future__ import annotations

import re
from collections.abc import Sequence


def for_later_seat(columns: Sequence[str], players: Sequence[str], seats: int) -> list[str]:
    """Return columns with each player replaced by the one that many seats later."""
    later = {name: players[(i + seats) % len(players)] for i, name in enumerate(players)}
    # Columns are facts such as `loc(robot1, table3)`: a name before a bracket is a predicate.
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, players))})\b(?!\()")
    return [pattern.sub(lambda found: later[found[0]], column) for column in columns]
