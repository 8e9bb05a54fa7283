"""The states of a game that was seen and is in no recording, in a file for another process."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgpack

from robotouille.domain.task import Task
from robotouille.world.world import State, World
from robotouille_client.window.replay.history.history import History

__all__ = ["ENDING", "SeenStates", "write_states"]

ENDING = ".states"


@dataclass(frozen=True, slots=True)
class SeenStates:
    """Those from step `first` on, each as `World.pack` makes bytes of it."""

    world: World
    first: int
    packed: tuple[bytes, ...]

    @classmethod
    def read(cls, path: Path) -> SeenStates:
        """What `write_states` wrote.

        Raises:
            OSError: It cannot be read.
            RobotouilleError: Its task is none.
        """
        task, first, packed = msgpack.unpackb(path.read_bytes(), use_list=False)
        return cls(World(Task.from_json(task)), first, packed)

    def states(self) -> Iterator[tuple[int, State]]:
        """The state at the first step and after each step from there on."""
        unpacked = (self.world.unpack(data) for data in self.packed)
        return enumerate(unpacked, self.first)


def write_states(history: History, path: Path) -> None:
    """Write the states of a history; OSError where that cannot be done."""
    steps = range(history.first, history.length + 1)
    packed = [history.world.pack(history.state(step)) for step in steps]
    path.write_bytes(msgpack.packb((history.world.task.to_json(), history.first, packed)))
