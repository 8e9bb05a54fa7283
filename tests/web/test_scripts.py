"""Types and lint of the browser client and of the programs that test it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from robotouille.web.site import STATIC
from tests.support.node import libraries, node
from tests.support.sources import ROOT

pytestmark = [pytest.mark.process, pytest.mark.slow]

FOLDER = Path(__file__).parent
SCRIPTS = [STATIC, *sorted(FOLDER.glob("*.mjs"))]


@pytest.fixture(scope="module")
def programs() -> Path:
    """Return the folder of the programs that npm has installed."""
    node()
    return libraries(FOLDER) / ".bin"


def faults(*command: str | Path) -> str:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    return (done.stdout + done.stderr).strip() if done.returncode else ""


def test_types_of_the_page_are_right(programs: Path) -> None:
    assert faults(programs / "tsc", "--project", STATIC.parent) == ""


def test_page_has_no_lint(programs: Path) -> None:
    assert faults(programs / "eslint", "--config", FOLDER / "eslint.config.mjs", *SCRIPTS) == ""
