"""Import contracts, optional libraries, folder sizes and dangerous calls."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from tests.support.sources import MODULES, ROOT, imported, module_name, parsed

MAX_IN_FOLDER = 22
DANGEROUS = re.compile(r"\b(eval|exec)\(|os\.system|pickle\.|\bshell=")
"""Texts of possibly dangerous calls; only files that contain one are parsed."""

TEST_FILES = sorted((ROOT / "tests").rglob("*.py"))


@pytest.mark.process
@pytest.mark.smoke
def test_import_contracts_hold() -> None:
    """Check the contracts in pyproject.toml, including type-only imports."""
    program = [str(Path(sys.executable).with_name("lint-imports")), "--no-logo", "--no-cache"]
    result = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_folders_are_small() -> None:
    held = Counter(module_name(path).rpartition(".")[0] for path in MODULES)
    assert {folder: count for folder, count in held.items() if count > MAX_IN_FOLDER} == {}


@pytest.mark.slow
def test_no_test_imports_another_test() -> None:
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


def test_support_does_not_import_programs() -> None:
    for path in TEST_FILES:
        if path.is_relative_to(ROOT / "tests/support"):
            for name in imported(path):
                assert not name.startswith("tests.programs"), f"{path} imports {name}"


@pytest.mark.process
@pytest.mark.smoke
def test_core_imports_neither_pygame_nor_asyncio() -> None:
    program = (
        "import sys, robotouille, robotouille.episode, robotouille.replay.recording\n"
        "assert 'asyncio' not in sys.modules and 'pygame' not in sys.modules\n"
        "assert 'websockets' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_no_dangerous_calls() -> None:
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
