"""Functions that are compiled where the extra `fast` is installed, and plain Python else.

Set ROBOTOUILLE_COMPILE=0 to have plain Python in any case.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

__all__ = ["COMPILED", "cache_folder", "compiler", "lowest_bit", "unsigned"]

F = TypeVar("F", bound=Callable[..., Any])


def _numba_module() -> Any:
    if os.environ.get("ROBOTOUILLE_COMPILE") == "0":
        return None
    try:
        return import_module("numba")
    except ImportError:
        return None


_numba: Any = _numba_module()

COMPILED = _numba is not None
"""Whether functions are compiled."""


def compiler(folder: Path, bare: bool = False) -> Callable[[F], F]:
    """A decorator for the functions of a folder: the function, compiled if possible.

    What is compiled is kept on disk for the next time.

    Args:
        folder: Where all that is called from compiled functions is defined.
        bare: Whether they make neither arrays nor views of arrays. Then nobody counts who refers to
            an array, which is half of what calls cost, and other threads run meanwhile.
    """

    def kernel(function: F) -> F:
        if not COMPILED:
            return function
        before = _numba.config.CACHE_DIR
        _numba.config.CACHE_DIR = str(cache_folder(folder))
        try:
            compiled: F = _numba.njit(cache=True, nogil=bare, _nrt=not bare)(function)
        finally:
            _numba.config.CACHE_DIR = before
        return compiled

    return kernel


def _plain_lowest_bit(mask: int) -> int:
    return (int(mask) & -int(mask)).bit_length() - 1


def _compiled_lowest_bit() -> Any:
    """The processor's own instruction for it."""
    intrinsic = import_module("numba.extending").intrinsic
    types = import_module("numba").types
    ir = import_module("llvmlite").ir

    def trailing_zeros(typing: Any, mask: Any) -> Any:
        def instruction(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

        return types.int64(types.int64), instruction

    return intrinsic(trailing_zeros)


lowest_bit: Callable[[int], int] = _compiled_lowest_bit() if COMPILED else _plain_lowest_bit
"""The place of the lowest bit of a positive integer of 64 bits, compiled or not."""


def _compiled_unsigned() -> Any:
    intrinsic = import_module("numba.extending").intrinsic
    types = import_module("numba").types

    def same_bits(typing: Any, number: Any) -> Any:
        def instruction(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return arguments[0]

        return types.uint64(types.int64), instruction

    return intrinsic(same_bits)


unsigned: Callable[[int], int] = _compiled_unsigned() if COMPILED else int
"""An index that is not negative: compiled functions need not look whether it counts from an array's
end, which costs kernels that look up much about a sixth of their time."""


@cache
def cache_folder(folder: Path) -> Path:
    """Where the compiled functions of a folder are kept: one for each version of their source,
    since a function contains those it calls."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    source = b"".join(p.read_bytes() for p in sorted(folder.rglob("*.py")))
    return Path(home) / "robotouille" / hashlib.blake2b(source, digest_size=8).hexdigest()
