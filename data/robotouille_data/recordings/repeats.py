"""Which steps of a recording repeat an earlier one."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Any

__all__ = ["Repeats"]


class Repeats:
    """Counts the steps whose state and actions have been before, as the benchmark's
    `repeated_transitions` does, with a hash of 62 bits for a state's facts."""

    def __init__(self, atoms: int) -> None:
        self.count = 0
        self._random = random.Random(0)
        self._keys: list[int] = []
        self._extend(atoms)
        self._facts = 0
        self._timers: dict[str, tuple[int, ...]] = {}
        self._others = 0
        self._seen: set[int] = set()

    def begin(self, frame: Mapping[str, Any]) -> None:
        """The state before the first step; IndexError if it has a fact that no table has."""
        for fact in frame["facts"]:
            self._facts ^= self._keys[fact]
        self._timers = {str(label): tuple(counters) for label, counters in frame["timers"]}
        self._look_at_timers(frame["busy"])

    def step(
        self, frame: Mapping[str, Any], actions: tuple[Any, ...], busy: dict[str, int]
    ) -> None:
        """A step, with the actions that applied; IndexError as in `begin`.

        Args:
            busy: Who is busy after it.
        """
        key = hash((self._facts, self._others, actions))
        if key in self._seen:
            self.count += 1
        self._seen.add(key)
        if "atoms" in frame:
            self._extend(len(frame["atoms"]))
        for fact in frame.get("add", ()):
            self._facts ^= self._keys[fact]
        for fact in frame.get("remove", ()):
            self._facts ^= self._keys[fact]
        if "timers" not in frame and "busy" not in frame:
            return
        for label, counters in frame.get("timers", {}).items():
            if counters is None:
                self._timers.pop(label, None)
            else:
                self._timers[label] = tuple(counters)
        self._look_at_timers(busy)

    def _extend(self, atoms: int) -> None:
        self._keys += (self._random.getrandbits(62) for _ in range(atoms))

    def _look_at_timers(self, busy: Mapping[str, int]) -> None:
        self._others = hash((frozenset(self._timers.items()), frozenset(busy.items())))
