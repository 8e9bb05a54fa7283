"""Trajectories for imitation learning: one `.npz` per task, with a row per step and seat."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import chain, groupby
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from robotouille.errors import SlotOverflowError, UnknownNameError
from robotouille.world.world import World
from robotouille_data.exports.recorded import RecordedMoment, SimulatedEpisode, replays
from robotouille_data.exports.request import ExportEntry, Field, Part, WrittenFile

LEVEL = 3
"""Compression level. Observations are mostly 0; higher levels cost time and gain little."""


class GrowingArrays:
    """Arrays of one row per step and seat that grow on disk.

    Args:
        folder: Folder for temporary files.
        fields: Type and row shape of each array by name.
    """

    def __init__(
        self, folder: Path, fields: Mapping[str, tuple[npt.DTypeLike, tuple[int, ...]]]
    ) -> None:
        self._folder = folder
        self._fields = {name: (np.dtype(kind), shape) for name, (kind, shape) in fields.items()}
        self._open = ExitStack()
        self._files: dict[str, IO[bytes]] = {}
        self.rows = 0

    def __enter__(self) -> GrowingArrays:
        for name in self._fields:
            file = tempfile.TemporaryFile(dir=self._folder)
            self._files[name] = self._open.enter_context(file)
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def append(self, **values: Any) -> None:
        """Add a row."""
        for name, (kind, shape) in self._fields.items():
            row = np.broadcast_to(np.asarray(values[name], kind), shape)
            # Rows are written at once, because a study's vectors and masks do not fit into memory.
            self._files[name].write(row.tobytes())
        self.rows += 1

    def cut(self, rows: int) -> None:
        """Keep only the first rows."""
        for name, (kind, shape) in self._fields.items():
            file = self._files[name]
            file.seek(rows * kind.itemsize * int(np.prod(shape)))
            file.truncate()
        self.rows = rows

    def save(self, path: Path) -> None:
        """Write the `.npz` file."""
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as archive:
            for name, (kind, shape) in self._fields.items():
                # `ZipInfo` has a fixed date, so equal episodes give equal files.
                entry = zipfile.ZipInfo(f"{name}.npy")
                entry.compress_type = zipfile.ZIP_DEFLATED
                with archive.open(entry, "w", force_zip64=True) as file:
                    head = {
                        "descr": np.lib.format.dtype_to_descr(kind),
                        "fortran_order": False,
                        "shape": (self.rows, *shape),
                    }
                    np.lib.format.write_array_header_1_0(file, head)
                    self._files[name].seek(0)
                    shutil.copyfileobj(self._files[name], file)


NOTHING = -1
"""Action number of a seat without an applied action in the step."""


def layout_notes(world: World) -> dict[str, Any]:
    """Return the task, and names for the elements of vectors and for the players' actions."""
    encoding = world.encoding
    return {
        "task": world.task.name,
        "digest": world.task.digest,
        "layout_version": encoding.version,
        "columns": list(encoding.columns),
        "actions": {
            player: [action.sentence for action in world.ground_actions(player)]
            for player in world.players
        },
    }


def action_number(moment: RecordedMoment, player: str) -> int:
    """Return the number of a player's applied action in a step."""
    move = moment.moves.get(player)
    return NOTHING if move is None else moment.before.action_number(move.action, player)


def write_arrays(part: Part) -> Iterator[WrittenFile]:
    """Write one file per task."""
    for _, its in groupby(replays(part), key=lambda replay: replay.task.digest):
        yield _write_task(part, its)


def _write_task(part: Part, episodes: Iterator[SimulatedEpisode]) -> WrittenFile:
    first = next(episodes)
    world = first.world
    name = part.tasks[world.task.digest]
    path = part.folder / f"{name}.npz"
    size = world.encoding.size
    most = max(len(world.ground_actions(player)) for player in world.players)
    part.codebook[name] = _entry(name, world, size, most)
    actions, rewards = 0, 0.0
    with GrowingArrays(part.folder, _fields(size, most)) as arrays:
        for replay in chain([first], episodes):
            rows = arrays.rows
            try:
                sums = _add(arrays, replay, most)
            except (SlotOverflowError, UnknownNameError) as error:
                # The error may come after some of the episode's rows were written.
                arrays.cut(rows)
                part.faults[replay.episode_id] = str(error)
                continue
            actions, rewards = actions + sums[0], rewards + sums[1]
        arrays.save(path)
        return WrittenFile(
            name, part.path(path), arrays.rows, {"actions": actions, "rewards": rewards}
        )


def _add(arrays: GrowingArrays, replay: SimulatedEpisode, most: int) -> tuple[int, float]:
    """Add the rows of an episode, and return the sums of its actions and rewards."""
    actions, rewards = 0, 0.0
    for moment in replay.moments:
        whole = None if replay.sight else moment.before.vector()
        for seat, player in enumerate(replay.world.players):
            observed = replay.observed(moment.before, player)
            mask = observed.mask()
            number, move = action_number(moment, player), moment.moves.get(player)
            arrays.append(
                observations=observed.vector() if whole is None else whole,
                masks=np.pad(mask, (0, most - len(mask))),
                actions=number,
                own=move is not None and move.own,
                rewards=moment.reward,
                terminations=moment.terminates,
                episode=replay.episode_id,
                step=moment.step,
                seat=seat,
            )
            actions, rewards = actions + number, rewards + moment.reward
    return actions, rewards


def _fields(size: int, most: int) -> dict[str, tuple[type, tuple[int, ...]]]:
    return {
        "observations": (np.float32, (size,)),
        "masks": (np.bool_, (most,)),
        "actions": (np.int32, ()),
        "own": (np.bool_, ()),
        "rewards": (np.float32, ()),
        "terminations": (np.bool_, ()),
        "episode": (np.int64, ()),
        "step": (np.int32, ()),
        "seat": (np.int32, ()),
    }


def _entry(name: str, world: World, size: int, most: int) -> ExportEntry:
    return ExportEntry(
        name,
        f"the task {world.task.name}: one row per step and seat of an episode",
        (
            Field("observations", f"float32, (rows, {size})",
                  "state before the step, as `State.vector()`; `columns` names its elements"),
            Field("masks", f"bool, (rows, {most})",
                  "valid `actions` of the seat; a seat with fewer actions is padded with false"),
            Field("actions", "int32",
                  "applied action, as an index of the seat's `actions`; -1: none"),
            Field("own", "bool", "true if the participant chose the action; false for a substitute "
                  "or no action"),
            Field("rewards", "float32", "points of a shift, or 1 in the step to the goal"),
            Field("terminations", "bool", "the step reached the goal, or ended the shift"),
            Field("episode", "int64", "`episodes.id` of the catalogue"),
            Field("step", "int32", "step number, from 1"),
            Field("seat", "int32", "`seats.seat` of the catalogue"),
        ),
        layout_notes(world),
    )  # fmt: skip
