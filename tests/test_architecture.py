"""Imports point one way, optional libraries stay optional, and public names are declared."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.sources import (
    MODULES,
    ROOT,
    SOURCES,
    imported,
    module_name,
    parsed,
)

MAX_IN_FOLDER = 12
WIDE_FOLDERS = {
    "robotouille": 18,
    "robotouille.planners.kitchen": 14,
    "robotouille_client.window": 14,
}
"""Folders that hold more than they should, and how much they hold at most."""

DANGEROUS = re.compile(r"\b(eval|exec)\(|os\.system|pickle\.|\bshell=")
"""What a file says that may call something dangerous; only those are parsed."""

TEST_FILES = sorted((ROOT / "tests").rglob("*.py"))


@pytest.mark.process
@pytest.mark.smoke
def test_imports_keep_their_contracts() -> None:
    """Layers and no circles, type-only imports included: the contracts are in pyproject.toml."""
    program = [str(Path(sys.executable).with_name("lint-imports")), "--no-logo", "--no-cache"]
    result = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_folders_are_small() -> None:
    held = Counter(module_name(path).rpartition(".")[0] for path in MODULES)
    wide = {folder: count for folder, count in held.items() if count > MAX_IN_FOLDER}
    assert not {folder for folder in wide if wide[folder] > WIDE_FOLDERS.get(folder, 0)}


@pytest.mark.slow
def test_no_test_imports_another_test() -> None:
    """What several tests need is in `tests/support`."""
    for path in TEST_FILES:
        for name in imported(path):
            words = name.split(".")
            assert not (words[0] == "tests" and any(w.startswith("test_") for w in words[:-1])), (
                f"{path} imports {name}"
            )


def test_every_program_runs_as_a_module_too() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    paths = {module_name(path): path for path in MODULES}
    for program, entry in project["scripts"].items():
        module, _, function = entry.partition(":")
        last = ast.unparse(parsed(paths[module]).body[-1])
        assert last == f"if __name__ == '__main__':\n    {function}()", program


def test_what_tests_share_needs_no_program() -> None:
    for path in TEST_FILES:
        if path.is_relative_to(ROOT / "tests/support"):
            for name in imported(path):
                assert not name.startswith("tests.programs"), f"{path} imports {name}"


@pytest.mark.process
@pytest.mark.smoke
def test_the_core_needs_neither_pygame_nor_asyncio() -> None:
    """The pure core is importable without the shells' libraries."""
    program = (
        "import sys, robotouille, robotouille.episode, robotouille.replay.recording\n"
        "assert 'asyncio' not in sys.modules and 'pygame' not in sys.modules\n"
        "assert 'websockets' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_public_names_are_declared_and_exist() -> None:
    for path in MODULES:
        check_public_names(path)


def check_public_names(path: Path) -> None:
    tree = parsed(path)
    assigned = [
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign)
        and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)
    ]
    if not assigned:
        assert path.name in ("__init__.py", "__main__.py"), f"{path} has no __all__"
        return
    defined = {
        name
        for node in outside_functions(tree)
        for name in [
            getattr(node, "name", None),
            node.id if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else None,
            *([a.asname or a.name for a in node.names] if isinstance(node, ast.ImportFrom) else []),
        ]
        if name
    }
    names = assigned[0]
    assert set(names) <= defined, f"{path} declares what it has not"
    in_order = sorted(names, key=lambda n: (not n.isupper(), not n[0].isupper(), n))
    assert names == in_order, f"__all__ of {path} is not sorted"


def outside_functions(tree: ast.Module) -> Iterator[ast.AST]:
    """What a module defines is here, and nothing of the insides of functions and classes."""
    for statement in tree.body:
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield statement
        else:
            yield from ast.walk(statement)


def test_no_dangerous_calls() -> None:
    """Never pickle, eval or shell on anything from outside."""
    for path in MODULES:
        if not DANGEROUS.search(path.read_text(encoding="utf-8")):
            continue
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                assert name not in ("eval", "exec", "os.system"), path
                assert not name.startswith("pickle."), path
                for keyword in node.keywords:
                    assert keyword.arg != "shell", path


@pytest.mark.parametrize("package", ["episode", "protocol", "replay"])
def test_every_module_has_tests_under_its_name(package: str) -> None:
    modules = {path.stem for path in (SOURCES["robotouille"] / package).glob("[!_]*.py")}
    tests = {path.stem for path in (ROOT / "tests" / package).glob("test_*.py")}
    assert {f"test_{module}" for module in modules} <= tests
