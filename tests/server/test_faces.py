"""What packages of the server export, and that it is had from there."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

SERVER = Path(__file__).resolve().parents[2] / "server/robotouille_server"
FACES = ["auth", "conversation", "transport", "rooms.recordings"]
TABLES = {"limit_table.py"}
"""Modules that list the constants of all others."""


def imported(path: Path) -> list[str]:
    return [
        node.module
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module
    ]


@pytest.mark.parametrize("face", FACES)
def test_others_import_from_the_package(face: str) -> None:
    folder = SERVER.joinpath(*face.split("."))
    inside = f"robotouille_server.{face}."
    for path in SERVER.rglob("*.py"):
        if not path.is_relative_to(folder) and path.name not in TABLES:
            assert not [name for name in imported(path) if name.startswith(inside)], path


@pytest.mark.process
@pytest.mark.parametrize(
    ("module", "without"),
    [
        (
            "rooms.substitutes.worker_main",
            ("asyncio", "structlog", "websockets", "prometheus_client"),
        ),
        ("runtime.settings", ("structlog", "websockets", "prometheus_client")),
        ("app", ("fastapi", "uvicorn")),
        ("limit_table", ("fastapi",)),
    ],
)
def test_nothing_heavy_is_imported_where_it_is_not_needed(
    module: str, without: tuple[str, ...]
) -> None:
    program = (
        f"import sys, robotouille_server.{module}\n"
        f"found = [name for name in {without!r} if name in sys.modules]\n"
        "assert not found, found"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


UNTESTED = {"errors", "models", "timeouts"}
"""Modules that hold data only."""


def test_every_module_has_a_test_file_of_its_name() -> None:
    tests = {
        path.stem.removeprefix("test_") for path in SERVER.parents[1].glob("tests/*/test_*.py")
    }
    modules = {path.stem for path in SERVER.rglob("*.py") if not path.stem.startswith("__")}
    assert modules - UNTESTED <= tests
