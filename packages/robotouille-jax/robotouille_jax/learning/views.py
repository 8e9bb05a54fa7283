"""Inputs of each seat's network: the state's vector with the seat's own player first."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.world.arrays.encoding import Encoding


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
        turned = {p: players[(i + seat) % len(players)] for i, p in enumerate(players)}
        rows.append([place.get(_renamed(name, turned), -1) for name in names])
    columns = np.array(rows, np.int32)
    if np.any(np.sort(columns, axis=1) != np.arange(len(names))):
        columns = np.tile(np.arange(len(names), dtype=np.int32), (len(players), 1))
    counters = len(encoding.atoms)
    scale = np.ones(len(names), np.float32)
    scale[counters:] = 0.25
    scale[[name.startswith(("steps_left", "order")) for name in names]] = 1 / encoding.high
    return Views(columns, scale)


def _renamed(name: str, turned: dict[str, str]) -> str:
    return re.sub(r"\w+", lambda word: turned.get(word[0], word[0]), name)
