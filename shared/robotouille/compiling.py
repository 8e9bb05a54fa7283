"""Optional compilation of functions with numba, which the extra `fast` installs.

Without numba, the functions run as plain Python. ROBOTOUILLE_COMPILE=0 disables numba.
"""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

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
"""True if functions are compiled."""


def warn_if_slow(what: str, times: int) -> None:
    """Warn that something is slow because numba is not installed.

    Python shows the warning once for each line that calls the caller of this function.
    `ROBOTOUILLE_COMPILE=0` hides it.
    """
    if not COMPILED and os.environ.get("ROBOTOUILLE_COMPILE") != "0":
        warnings.warn(
            f"{what} runs {times} times slower without numba: pip install 'robotouille[fast]' "
            "(ROBOTOUILLE_COMPILE=0 hides this warning)",
            RuntimeWarning,
            stacklevel=3,
        )


def compiler(folder: Path, bare: bool = False) -> Callable[[F], F]:
    """Return a decorator that compiles a folder's functions if numba is installed.

    Compiled functions are cached on disk.

    Args:
        folder: Folder that defines every function that the compiled functions call.
        bare: The functions create neither arrays nor views of arrays.
    """

    def kernel(function: F) -> F:
        if not COMPILED:
            return function
        before = _numba.config.CACHE_DIR
        _numba.config.CACHE_DIR = str(cache_folder(folder))
        try:
            # Without arrays, calls need no reference counting, which is half of their cost, and
            # kernels can release the GIL.
            compiled: F = _numba.njit(cache=True, nogil=bare, _nrt=not bare)(function)
        finally:
            _numba.config.CACHE_DIR = before
        return compiled

    return kernel


def _plain_lowest_bit(mask: int) -> int:
    return (int(mask) & -int(mask)).bit_length() - 1


def _compiled_lowest_bit() -> Any:
    """Compile to the processor's instruction for counting trailing zeros."""
    intrinsic = import_module("numba.extending").intrinsic
    types = import_module("numba").types
    ir = import_module("llvmlite").ir

    def trailing_zeros(typing: Any, mask: Any) -> Any:
        def instruction(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

        return types.int64(types.int64), instruction

    return intrinsic(trailing_zeros)


lowest_bit: Callable[[int], int] = _compiled_lowest_bit() if COMPILED else _plain_lowest_bit
"""Position of the lowest set bit of a positive 64-bit integer."""


def _compiled_unsigned() -> Any:
    intrinsic = import_module("numba.extending").intrinsic
    types = import_module("numba").types

    def same_bits(typing: Any, number: Any) -> Any:
        def instruction(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return arguments[0]

        return types.uint64(types.int64), instruction

    return intrinsic(same_bits)


# For signed indices, numba also handles counting from the end of an array. Skipping that saves
# kernels with many lookups about a sixth of their time.
unsigned: Callable[[int], int] = _compiled_unsigned() if COMPILED else int
"""Conversion of a non-negative index to an unsigned integer."""


@cache
def cache_folder(folder: Path) -> Path:
    """Return the cache folder for a folder's compiled functions.

    Each installation has its own, because numba reuses no code compiled for files elsewhere.
    """
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    # The name depends on all sources because numba inlines the functions that a function calls.
    source = b"".join(p.read_bytes() for p in sorted(folder.rglob("*.py")))
    source += os.fsencode(folder)
    return Path(home) / "robotouille" / hashlib.blake2b(source, digest_size=8).hexdigest()
