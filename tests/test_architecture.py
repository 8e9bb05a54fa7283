"""Imports point one way, optional libraries stay optional, and public names are declared."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = {
    "robotouille": ROOT / "shared/robotouille",
    "robotouille_server": ROOT / "server/robotouille_server",
    "robotouille_client": ROOT / "client/robotouille_client",
}
LAYERS = ["domain", "world", ("planning", "episode"), "generation", "protocol", "replay"]
ALLOWED = {
    "robotouille": {"robotouille"},
    "robotouille_server": {"robotouille", "robotouille_server"},
    "robotouille_client": {"robotouille", "robotouille_client"},
}
MODULES = sorted(p for folder in SOURCES.values() for p in folder.rglob("*.py"))


def imports(path: Path) -> list[str]:
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.append(node.module)
    return names


def rank(part: str) -> int | None:
    for i, layer in enumerate(LAYERS):
        if part == layer or (part in layer and isinstance(layer, tuple)):
            return i
    return None


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    package = next(name for name, folder in SOURCES.items() if path.is_relative_to(folder))
    own = path.relative_to(SOURCES[package]).parts[0]
    for name in imports(path):
        top = name.split(".")[0]
        if top.startswith("robotouille"):
            assert top in ALLOWED[package], f"{path} imports {name}"
        parts = name.split(".")
        if package == top == "robotouille" and len(parts) > 1 and rank(own) is not None:
            other = rank(parts[1])
            assert other is None or other <= (rank(own) or 0), f"{own} imports {name}"
            same_layer = other == rank(own) and parts[1] != own
            assert not same_layer, f"{own} imports its neighbour {name}"


def test_the_core_needs_neither_pygame_nor_asyncio() -> None:
    """The pure core is importable without the shells' libraries."""
    program = (
        "import sys, robotouille, robotouille.episode, robotouille.replay.recording\n"
        "assert 'asyncio' not in sys.modules and 'pygame' not in sys.modules\n"
        "assert 'websockets' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_public_names_are_declared_and_exist(path: Path) -> None:
    tree = ast.parse(path.read_text())
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
        for node in ast.walk(tree)
        for name in [
            getattr(node, "name", None),
            node.id if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else None,
            *([a.asname or a.name for a in node.names] if isinstance(node, ast.ImportFrom) else []),
        ]
        if name
    }
    assert set(assigned[0]) <= defined
    assert assigned[0] == sorted(
        assigned[0], key=lambda n: (not n.isupper(), not n[0].isupper(), n)
    )


def test_no_dangerous_calls() -> None:
    """Never pickle, eval or shell on anything from outside."""
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text())):
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
