"""Any state of a recording without the way there: from the last state in full, and what changed."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Mapping
from typing import Any

from robotouille.errors import RecordingError
from robotouille.protocol.states import StateReader
from robotouille.replay.container import frame_value
from robotouille.world.world import State, World

__all__ = ["RecordedStates"]

MAX_KEPT = 512
"""States that are kept: those around a place are asked for again and again."""


class RecordedStates:
    """The states of a recording by step, as the file has them.

    Args:
        stream: The recording's bytes, not compressed.
        tables: Those of its header.
    """

    def __init__(self, world: World, stream: bytes, tables: Mapping[str, Any]) -> None:
        self._world = world
        self._stream = stream
        self._predicates = tables["predicates"]
        self._objects = list(tables["objects"])
        self._atoms = list(tables["atoms"])
        self._positions = array("q")
        self._key_steps = array("q")
        self._keys: list[tuple[int, int, int]] = []
        self._kept: dict[int, State] = {}
        self._reader: StateReader | None = None
        self._reader_step = -1

    def add_step(self, frame: Mapping[str, Any], position: int) -> None:
        """The next step, whose frame begins at a position of the stream."""
        self._positions.append(position)
        self._objects += frame.get("objects", ())
        self._atoms += frame.get("atoms", ())

    def add_state(self, frame: Mapping[str, Any], position: int) -> None:
        """A state in full."""
        self._key_steps.append(frame["step"])
        self._keys.append((position, len(self._objects), len(self._atoms)))

    def frame(self, step: int) -> dict[str, Any]:
        """The frame of a step, from 1 on."""
        return frame_value(self._stream, self._positions[step - 1])

    def state(self, step: int) -> State:
        """The state after a step.

        Raises:
            RobotouilleError: The file tells of none, or what it tells makes no sense.
        """
        found = self._kept.get(step)
        if found is None:
            found = self._read(step)
        return found

    def _read(self, step: int) -> State:
        key = bisect_right(self._key_steps, step) - 1
        if key < 0:
            raise RecordingError(f"step {step}: there is no state before it")
        reader, at = self._reader, self._reader_step
        self._reader = None  # If a change makes no sense, it cannot be gone on from.
        if reader is None or not self._key_steps[key] <= at < step:
            reader, at = self._reader_at(key), self._key_steps[key]
            self._keep(at, reader.state)
        while at < step:
            at += 1
            self._keep(at, reader.apply(self.frame(at)))
        self._reader, self._reader_step = reader, at
        return reader.state

    def _reader_at(self, key: int) -> StateReader:
        position, objects, atoms = self._keys[key]
        tables = {
            "predicates": self._predicates,
            "objects": self._objects[:objects],
            "atoms": self._atoms[:atoms],
        }
        return StateReader(self._world, tables, frame_value(self._stream, position))

    def _keep(self, step: int, state: State) -> None:
        if len(self._kept) >= MAX_KEPT:
            for old in list(self._kept)[: MAX_KEPT // 2]:
                del self._kept[old]
        self._kept[step] = state
