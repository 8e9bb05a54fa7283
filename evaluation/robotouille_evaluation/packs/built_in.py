"""Built-in packs by name, and packs of folders."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from robotouille.errors import UnknownNameError, did_you_mean
from robotouille_evaluation.packs.own import (
    NAME,
    SHIFTS,
    Progress,
    build_own_pack,
    build_shift_pack,
)
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.paper import PAPER, build_paper_pack
from robotouille_evaluation.packs.store import read_pack


class PackBuilder(Protocol):
    """Function that returns a built-in pack, and reports finished tasks and their number."""

    def __call__(self, progress: Progress | None = None) -> Pack: ...


BUILT_IN: Mapping[str, PackBuilder] = {
    NAME: build_own_pack,
    SHIFTS: build_shift_pack,
    PAPER: build_paper_pack,
}


def is_built_in(name: str | Path) -> bool:
    """Return whether a name is that of a built-in pack, and no folder in the way has it."""
    return str(name) in BUILT_IN and not Path(name).is_dir()


def find_pack(name: str | Path) -> Pack:
    """Return the built-in pack with a name, or the pack in a folder.

    Raises:
        UnknownNameError: There is no such folder, and the name resembles a built-in pack.
        FileError: The folder has no valid pack.
    """
    if is_built_in(name):
        return BUILT_IN[str(name)]()
    near = did_you_mean(str(name), BUILT_IN)
    if near and not Path(name).exists():
        raise UnknownNameError(f"no pack {str(name)!r}{near}")
    return read_pack(Path(name))
