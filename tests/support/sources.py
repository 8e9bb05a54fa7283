"""The modules of the three packages and of the tests, and who imports whom."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

__all__ = [
    "MODULES",
    "ROOT",
    "SOURCES",
    "circles",
    "import_graph",
    "imported",
    "module_name",
    "parsed",
]

ROOT = Path(__file__).resolve().parents[2]
SOURCES = {
    "robotouille": ROOT / "shared/robotouille",
    "robotouille_server": ROOT / "server/robotouille_server",
    "robotouille_client": ROOT / "client/robotouille_client",
}
MODULES = sorted(p for folder in SOURCES.values() for p in folder.rglob("*.py"))


def module_name(path: Path) -> str:
    """The dotted name of a file of the packages or of the tests."""
    inside = path.relative_to(ROOT)
    parts = inside.parts if inside.parts[0] == "tests" else inside.parts[1:]
    return ".".join(parts).removesuffix(".py").removesuffix(".__init__")


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file, read once."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported(path: Path) -> tuple[str, ...]:
    """What a file imports, anywhere in it and also only for types: `module`, or `module.name` for
    each name taken from a module."""
    found: list[str] = []
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(found)


def import_graph(paths: Iterable[Path]) -> dict[str, set[str]]:
    """The files that each file imports, as names of modules; only those among `paths`."""
    names = {module_name(path): path for path in paths}
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        found = (whole if whole in names else whole.rpartition(".")[0] for whole in imported(path))
        graph[name] = {one for one in found if one in names and one != name}
    return graph


def circles(graph: Mapping[str, set[str]]) -> set[frozenset[str]]:
    """The groups of modules that import each other, directly or through others."""
    reach = {name: _reached(graph, name) for name in graph}
    return {
        frozenset({name} | {other for other in reach[name] if name in reach[other]})
        for name in graph
        if name in reach[name]
    }


def _reached(graph: Mapping[str, set[str]], start: str) -> set[str]:
    found: set[str] = set()
    waiting = list(graph[start])
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += graph[name]
    return found
