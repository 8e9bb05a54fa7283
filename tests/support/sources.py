"""The modules of the packages and tests, with their imports."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

__all__ = [
    "MODULES",
    "ROOT",
    "SOURCES",
    "imported",
    "module_name",
    "parsed",
]

ROOT = Path(__file__).resolve().parents[2]
SOURCES = {
    "robotouille": ROOT / "shared/robotouille",
    "robotouille_server": ROOT / "server/robotouille_server",
    "robotouille_client": ROOT / "client/robotouille_client",
    "robotouille_evaluation": ROOT / "evaluation/robotouille_evaluation",
    "robotouille_data": ROOT / "data/robotouille_data",
}
MODULES = sorted(p for folder in SOURCES.values() for p in folder.rglob("*.py"))


def module_name(path: Path) -> str:
    """Return the dotted name of a file in the packages or tests."""
    inside = path.relative_to(ROOT)
    parts = inside.parts if inside.parts[0] == "tests" else inside.parts[1:]
    return ".".join(parts).removesuffix(".py").removesuffix(".__init__")


def parsed(path: Path) -> ast.Module:
    """Return a file's syntax tree, uncached, because many trees slow the garbage collector."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Return all imports of a file, including imports for types, as `module`, or as `module.name`
    for each imported name.
    """
    found: list[str] = []
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(found)
