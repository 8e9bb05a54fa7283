"""Which stations of a grid a player can reach: the one question the published generator asks."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

__all__ = ["Cell", "Floor"]

Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Floor:
    """A grid of `width` by `height` cells; a player stands on any cell without a station."""

    width: int
    height: int

    def cells(self) -> list[Cell]:
        """All cells, column by column."""
        return [(x, y) for x in range(self.width) for y in range(self.height)]

    def neighbours(self, cell: Cell) -> Iterator[Cell]:
        """The cells of the grid above, below, right and left of a cell, in this order."""
        x, y = cell
        for near in ((x, y + 1), (x, y - 1), (x + 1, y), (x - 1, y)):
            if 0 <= near[0] < self.width and 0 <= near[1] < self.height:
                yield near

    def reaches(self, stations: Collection[Cell], start: Cell) -> bool:
        """Whether one who begins at `start` can stand beside every station.

        A start that is itself a station counts as standing beside that station only.
        """
        wanted = set(stations)
        if start in wanted:
            return wanted == {start}
        return self._touched(wanted, start)[0] >= wanted

    def reachable(self, stations: Collection[Cell]) -> bool:
        """Whether one can stand beside every station from some cell."""
        wanted = set(stations)
        unseen = set(self.cells()) - wanted
        while unseen:
            touched, flooded = self._touched(wanted, min(unseen))
            if touched >= wanted:
                return True
            unseen -= flooded
        return False

    def _touched(self, stations: set[Cell], start: Cell) -> tuple[set[Cell], set[Cell]]:
        """The stations beside the region of `start`, and that region."""
        flooded, touched, pending = {start}, set(), [start]
        while pending:
            for near in self.neighbours(pending.pop()):
                if near in stations:
                    touched.add(near)
                elif near not in flooded:
                    flooded.add(near)
                    pending.append(near)
        return touched, flooded
