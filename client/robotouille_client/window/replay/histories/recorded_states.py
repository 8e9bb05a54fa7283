"""Random access to the states of a recording, and files of states for the search."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgpack

from robotouille.domain.task import Task
from robotouille.errors import RecordingError
from robotouille.protocol.states import GrowingTable, StateReader
from robotouille.replay.container import frame_value
from robotouille.world.world import State, World
from robotouille_client.sansio.state_bytes import state_bytes
from robotouille_client.window.replay.histories.history import History

ENDING = ".states"


@dataclass(frozen=True, slots=True)
class SavedStates:
    """States from step `first` on, each packed by `World.pack`."""

    world: World
    first: int
    packed: tuple[bytes, ...]

    @classmethod
    def read(cls, path: Path) -> SavedStates:
        """Read what `write_states` wrote.

        Raises:
            OSError: The file cannot be read.
            RobotouilleError: Its task is invalid.
        """
        task, first, packed = msgpack.unpackb(path.read_bytes(), use_list=False)
        return cls(World(Task.from_json(task)), first, packed)

    def states(self) -> Iterator[tuple[int, State]]:
        """Yield each step with the state after it."""
        unpacked = (self.world.unpack(data) for data in self.packed)
        return enumerate(unpacked, self.first)


def write_states(history: History, path: Path) -> None:
    """Write the states of a history.

    Raises:
        OSError: The file cannot be written.
    """
    steps = range(history.first, history.length + 1)
    packed = [history.world.pack(history.state(step)) for step in steps]
    path.write_bytes(msgpack.packb((history.world.task.to_json(), history.first, packed)))


# States cached: those around the playhead are needed again and again.
MAX_KEPT = 512
MAX_KEPT_BYTES = 64 * 2**20


class RecordedStates:
    """States of a recording by step.

    A state is read from the last full state before it, with the changes since.

    Args:
        stream: Bytes of the recording, uncompressed.
        tables: Tables of its header.
    """

    def __init__(self, world: World, stream: bytes, tables: Mapping[str, Any]) -> None:
        self._world = world
        self._stream = stream
        self._predicates = tables["predicates"]
        self._objects = GrowingTable[tuple[str, ...]](map(tuple, tables["objects"]))
        self._atoms = GrowingTable[tuple[int, ...]](map(tuple, tables["atoms"]))
        self._positions = array("q")
        self._key_steps = array("q")
        self._keys: list[tuple[int, int, int]] = []
        self._kept: dict[int, State] = {}
        self._kept_bytes = 0
        self._reader: StateReader | None = None
        self._reader_step = -1

    def add_step(self, frame: Mapping[str, Any], position: int) -> None:
        """Add the next step, whose frame starts at a position of the stream."""
        self._positions.append(position)
        self._objects.extend(map(tuple, frame.get("objects", ())))
        self._atoms.extend(map(tuple, frame.get("atoms", ())))

    def add_state(self, frame: Mapping[str, Any], position: int) -> None:
        """Add a full state."""
        self._key_steps.append(frame["step"])
        self._keys.append((position, len(self._objects.rows), len(self._atoms.rows)))

    def frame(self, step: int) -> dict[str, Any]:
        """Return the frame of a step (from 1)."""
        return frame_value(self._stream, self._positions[step - 1])

    def state(self, step: int) -> State:
        """Return the state after a step.

        Raises:
            RobotouilleError: The file has no such state, or its changes make no sense.
        """
        found = self._kept.get(step)
        if found is None:
            found = self._read(step)
        return found

    def _read(self, step: int) -> State:
        key = bisect_right(self._key_steps, step) - 1
        if key < 0:
            raise RecordingError(f"step {step}: no full state comes before it")
        # Playing forward goes on from the last state instead of the last full one.
        reader, at = self._reader, self._reader_step
        self._reader = None  # A reader that failed on a change cannot be used again.
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
            "objects": self._objects.rows[:objects],
            "atoms": self._atoms.rows[:atoms],
        }
        return StateReader(self._world, tables, frame_value(self._stream, position))

    def _keep(self, step: int, state: State) -> None:
        if step in self._kept:
            return
        size = state_bytes(state)
        while self._kept and (
            len(self._kept) >= MAX_KEPT or self._kept_bytes + size > MAX_KEPT_BYTES
        ):
            # Dictionaries keep the order of insertion: the first half is the oldest.
            for old in list(self._kept)[: (len(self._kept) + 1) // 2]:
                self._kept_bytes -= state_bytes(self._kept.pop(old))
        self._kept[step] = state
        self._kept_bytes += size
