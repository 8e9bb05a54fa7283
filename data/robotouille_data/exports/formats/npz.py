"""Arrays that grow on the disk, and become one `.npz` that is read without pickles."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

__all__ = ["GrowingArrays"]

LEVEL = 3
"""Of the compression: facts are mostly 0, and more takes time for little."""


class GrowingArrays:
    """Some arrays that have one row for each step and seat.

    Args:
        folder: On whose disk they grow.
        fields: By name the type and the shape of a row.
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
            self._files[name].write(row.tobytes())
        self.rows += 1

    def cut(self, rows: int) -> None:
        """Forget all rows but the first ones."""
        for name, (kind, shape) in self._fields.items():
            file = self._files[name]
            file.seek(rows * kind.itemsize * int(np.prod(shape)))
            file.truncate()
        self.rows = rows

    def save(self, path: Path) -> None:
        """Write the file."""
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as archive:
            for name, (kind, shape) in self._fields.items():
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
