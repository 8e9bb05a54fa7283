"""Public names of a package, imported on first access (PEP 562).

A program's `--help` then imports only the modules that its options need. Packages also import the
names under `if TYPE_CHECKING`, for type checkers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_exports(package: str, *modules: str) -> Callable[[str], Any]:
    """Return a `__getattr__` that looks up the names of a package's `__all__` in these modules.

    The modules are tried in order, so list the cheapest to import first.
    """

    def get(name: str) -> Any:
        if name in sys.modules[package].__all__:
            for module in map(import_module, modules):
                if hasattr(module, name):
                    value = getattr(module, name)
                    setattr(sys.modules[package], name, value)
                    return value
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get
