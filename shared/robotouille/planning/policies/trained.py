"""Policies trained by reinforcement learning, from files of arrays; they need NumPy alone.

`robotouille-train` writes the files: the layers of an actor network, the columns of the state's
vector that each seat sees, and the layout for which they were trained.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from robotouille.errors import Fault, FileError, RobotouilleError, WrongWorldError
from robotouille.files.reading import open_regular
from robotouille.planning.policies.policy import Did
from robotouille.world.arrays.encoding import Encoding
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

VERSION = 1
"""Version of the file format."""
MAX_BYTES = 64 << 20
"""Largest size of a file's arrays, packed or not."""
MAX_ARRAYS = 200
MAX_NAME = 200
MAX_DIRECTORY_BYTES = 64 << 10
"""Largest list of an archive's entries. An entry of NumPy takes about 60 bytes."""
END, LOCATOR = b"PK\5\6", b"PK\6\7"
"""Signatures of the last record of an archive and, if it is large, of the record before."""
END_BYTES, LOCATOR_BYTES = 22, 20
PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Methods of compression that NumPy uses. Others can reserve gigabytes."""

Floats = npt.NDArray[np.float32]


def layout_of(encoding: Encoding, players: tuple[str, ...]) -> str:
    """Return a hash of the names of all numbers of a vector and of all players' actions.

    Tasks that differ in durations only have the same layout.
    """
    names = [*encoding.columns, *(str(a) for p in players for a in encoding.ground_actions(p))]
    return hashlib.blake2b("\n".join(names).encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class Actor:
    """A trained actor.

    Attributes:
        name: The name of the training run.
        task: The task for which it was trained, such as `training/03_multi_agent@2`.
        layout: See `layout_of`.
        columns: For each seat, the column of the state's vector behind each input.
        scale: The factor of each input.
        layers: Weights and biases. The last output stands for doing nothing.
    """

    name: str
    task: str
    layout: str
    columns: npt.NDArray[np.int32]
    scale: Floats
    layers: tuple[tuple[Floats, Floats], ...]

    def logits(self, seat: int, vector: Floats) -> Floats:
        """Return the output for a seat and a state's vector."""
        identity = np.zeros(len(self.columns), np.float32)
        identity[seat] = 1
        values = np.concatenate([vector[self.columns[seat]] * self.scale, identity])
        for weights, biases in self.layers[:-1]:
            values = np.maximum(values @ weights + biases, 0)
        weights, biases = self.layers[-1]
        output: Floats = values @ weights + biases
        return output


def write_actor(path: Path, actor: Actor) -> None:
    """Write an actor. Numbers of 16 bits halve the file and change no choice that matters."""
    arrays: dict[str, Any] = {
        f"{kind}{i}": array.astype(np.float16)
        for i, layer in enumerate(actor.layers)
        for kind, array in zip(("weights", "biases"), layer, strict=True)
    }
    for name in ("name", "task", "layout"):
        arrays[name] = np.str_(getattr(actor, name))
    np.savez_compressed(
        path, version=np.int64(VERSION), columns=actor.columns, scale=actor.scale, **arrays
    )


def read_actor(path: Path) -> Actor:
    """Read an actor.

    Raises:
        FileError: The file cannot be read or is not one of an actor.
    """
    try:
        with open_regular(path) as file:
            _check_archive(file)
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return _actor(arrays)
    except OSError as error:
        fault = Fault("", f"cannot be read: {error.strerror or error}")
    except UNREADABLE as error:
        why = str(error).partition("\n")[0]
        fault = Fault("", f"not a trained policy: {why}; robotouille-train writes such files")
    raise FileError(str(path), [fault])


UNREADABLE = (
    KeyError, TypeError, ValueError, EOFError, OverflowError, MemoryError, NotImplementedError,
    SyntaxError, RecursionError, TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""Errors of NumPy and of the archive about a file's content. NumPy parses headers as Python."""


def _check_archive(file: IO[bytes]) -> None:
    if file.seek(0, io.SEEK_END) > MAX_BYTES:
        raise ValueError(f"it is larger than {MAX_BYTES >> 20} MiB")
    _check_end(file)
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
    if len(entries) > MAX_ARRAYS:
        raise ValueError(f"it has more than {MAX_ARRAYS} arrays")
    if sum(entry.file_size for entry in entries) > MAX_BYTES:
        raise ValueError(f"its arrays are larger than {MAX_BYTES >> 20} MiB")
    if any(entry.compress_type not in PACKINGS or entry.flag_bits & 1 for entry in entries):
        raise ValueError("it is encrypted, or compressed in another way than NumPy does")


def _check_end(file: IO[bytes]) -> None:
    """Refuse an archive with too many entries, before `zipfile` makes an object of each."""
    size = file.seek(0, io.SEEK_END)
    file.seek(max(0, size - END_BYTES - LOCATOR_BYTES))
    last = file.read()
    end = last[-END_BYTES:]
    # If a comment follows, `zipfile` finds the record elsewhere. NumPy writes no comment.
    if not end.startswith(END) or not end.endswith(b"\0\0"):
        raise zipfile.BadZipFile("File is not a zip file")
    directory = int.from_bytes(end[12:16], "little")
    if last[:-END_BYTES].startswith(LOCATOR) or directory > MAX_DIRECTORY_BYTES:
        raise ValueError(f"it has more than {MAX_ARRAYS} arrays")


def _actor(arrays: Any) -> Actor:
    if (version := int(_array(arrays, "version", "i", 0))) != VERSION:
        raise ValueError(f"expected version {VERSION}, found {version}")
    count = sum(name.startswith("weights") for name in arrays.files)
    layers = tuple(
        (_floats(arrays, f"weights{i}", 2), _floats(arrays, f"biases{i}", 1)) for i in range(count)
    )
    columns, scale = _array(arrays, "columns", "i", 2), _floats(arrays, "scale", 1)
    if scale.shape != columns.shape[1:]:
        raise ValueError("columns and scale do not fit")
    width = sum(columns.shape)
    if np.any(np.sort(columns, axis=1) != np.arange(columns.shape[1])):
        raise ValueError("columns are not numbered from 0")
    for weights, biases in layers:
        if weights.shape != (width, *biases.shape):
            raise ValueError("the layers do not fit")
        width = len(biases)
    if not layers:
        raise ValueError("it has no layers")
    name, task, layout = (_text(arrays, key) for key in ("name", "task", "layout"))
    return Actor(name, task, layout, columns.astype(np.int32), scale, layers)


def _array(arrays: Any, name: str, kind: str, dimensions: int) -> npt.NDArray[Any]:
    """Return an array of a kind: "i" (integers), "f" (floats) or "U" (text)."""
    found = arrays[name]
    # NumPy returns an entry that is no array as bytes.
    if not isinstance(found, np.ndarray) or (found.dtype.kind, found.ndim) != (kind, dimensions):
        raise ValueError(f"{name} is not an array of the expected type")
    return found


def _floats(arrays: Any, name: str, dimensions: int) -> Floats:
    found = _array(arrays, name, "f", dimensions).astype(np.float32)
    if not np.isfinite(found).all():
        raise ValueError(f"{name} has numbers that are not finite")
    return found


def _text(arrays: Any, name: str) -> str:
    found = _array(arrays, name, "U", 0)
    # NumPy's own conversion fails with an internal error for numbers that are no characters.
    order = "big" if found.dtype.byteorder == ">" else "little"
    return found.tobytes().decode(f"utf-32-{order[0]}e").rstrip("\0")[:MAX_NAME]


class TrainedPolicy:
    """Policy of one seat that draws its actions from a trained actor. Equal seeds draw alike.

    Args:
        greedy: Take the most probable action instead.

    Raises:
        WrongWorldError: The actor was trained for another kitchen or another number of seats.
        RobotouilleError: The actor's network does not fit its kitchen.
    """

    def __init__(
        self, actor: Actor, state: State, player: str, seed: int = 0, *, greedy: bool = False
    ) -> None:
        world = state.world
        if layout_of(world.encoding, world.players) != actor.layout:
            raise WrongWorldError(
                f"{actor.name} was trained for {actor.task} and cannot play {world.task.name} "
                f"with {len(world.players)} seats"
            )
        _check_shape(actor, world)
        self._actor, self._player, self._greedy = actor, player, greedy
        self._seat = world.players.index(player)
        self._random = np.random.default_rng([seed, self._seat])

    def observe(self, did: Did) -> None:
        """Ignore the step: the network sees states only."""

    def act(self, state: State) -> GroundAction | None:
        """Return the action to take, or None to do nothing."""
        numbers = np.append(np.flatnonzero(state.mask(self._player)), -1)
        # A network of large numbers overflows.
        with np.errstate(over="ignore", invalid="ignore"):
            logits = self._actor.logits(self._seat, state.vector())[numbers].astype(float)
        if not np.isfinite(logits).all():
            raise RobotouilleError(f"{self._actor.name}: the network's numbers are too large")
        weights = np.exp(logits - logits.max())
        if self._greedy:
            chosen = int(numbers[np.argmax(weights)])
        else:
            chosen = int(self._random.choice(numbers, p=weights / weights.sum()))
        return None if chosen < 0 else state.action(self._player, chosen)


def _check_shape(actor: Actor, world: World) -> None:
    """Check that a network has an input for each number of a state and an output for each action.

    Raises:
        RobotouilleError: It has others.
    """
    seats, size = len(world.players), world.encoding.size
    outputs = {len(world.encoding.ground_actions(player)) + 1 for player in world.players}
    if actor.columns.shape != (seats, size) or outputs != {len(actor.layers[-1][1])}:
        raise RobotouilleError(f"{actor.name}: the network does not fit {world.task.name}")
