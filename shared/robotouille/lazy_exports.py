"""Public names of a package that are imported when they are first asked for.

A program's `--help` then costs what its options need, and no more. The package also imports the
names for type checkers, in a block under `if TYPE_CHECKING`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

__all__ = ["lazy_exports"]


def lazy_exports(package: str, *modules: str) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose `__all__` comes from these modules, the light first."""

    def get(name: str) -> Any:
        if name in sys.modules[package].__all__:
            for module in map(import_module, modules):
                if name in module.__all__:
                    value = getattr(module, name)
                    setattr(sys.modules[package], name, value)
                    return value
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get
