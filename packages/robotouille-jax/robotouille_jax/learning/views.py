"""Inputs of each seat's network: the state's vector with the seat's own player first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.world.arrays.encoding import Encoding
from robotouille.world.arrays.seat_columns import for_later_seat


class Views(NamedTuple):
    """Inputs of the networks.

    Attributes:
        columns: For each seat, the column of the state's vector behind each input.
        scale: Factor of each input, which brings counters near the range of facts, 0 to 1.
    """

    columns: npt.NDArray[np.int32]
    scale: npt.NDArray[np.float32]


def views(encoding: Encoding, players: tuple[str, ...]) -> Views:
    """Return the views of all seats.

    Seat 2 sees facts about its own player where seat 1 sees those about its own, so that what one
    seat learns is true for the other. If the seats cannot be exchanged, because a player cannot
    reach all stations for example, all seats see the vector as it is.
    """
    names = list(encoding.columns)
    place = {name: i for i, name in enumerate(names)}
    rows = []
    for seat in range(len(players)):
        rows.append([place.get(name, -1) for name in for_later_seat(names, players, seat)])
    columns = np.array(rows, np.int32)
    if np.any(np.sort(columns, axis=1) != np.arange(len(names))):
        columns = np.tile(np.arange(len(names), dtype=np.int32), (len(players), 1))
    counters = len(encoding.atoms)
    scale = np.ones(len(names), np.float32)
    scale[counters:] = 0.25
    scale[[name.startswith(("steps_left", "order")) for name in names]] = 1 / encoding.high
    return Views(columns, scale)
