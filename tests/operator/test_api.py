"""What is written about the API is so."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from robotouille_server.admin import openapi
from robotouille_server.admin.errors import CODES
from tests.support.operator import viewing
from tests.support.pages import DOCS, blocks, table
from tests.support.sources import ROOT
from tests.support.virtual_time import run


def operations(document: dict[str, Any]) -> set[str]:
    return {
        f"{method.upper()} {path}"
        for path, methods in document["paths"].items()
        for method in methods
    }


def test_the_openapi_document_is_current() -> None:
    kept = json.loads((DOCS / "openapi.json").read_text(encoding="utf-8"))
    assert kept == openapi(), "run: python tools/generate_docs.py"


def test_every_operation_says_what_it_is_and_how_it_fails() -> None:
    document = openapi()
    for methods in document["paths"].values():
        for operation in methods.values():
            assert operation["summary"]
            problem = operation["responses"]["default"]["content"]["application/json"]["schema"]
            assert problem == {"$ref": "#/components/schemas/Problem"}
            assert "422" not in operation["responses"]
        if "post" in methods:
            headers = [p["name"] for p in methods["post"]["parameters"] if p["in"] == "header"]
            assert headers == ["X-Robotouille-Operator"]


def test_every_path_is_in_the_guide() -> None:
    rows = {cell for row in table("operator.md", "The API") for cell in row[:1]}
    assert rows == operations(openapi())


def test_every_code_is_in_the_guide_and_used() -> None:
    assert [row[0] for row in table("operator.md", "Errors")] == list(CODES)
    folder = ROOT / "server/robotouille_server/admin"
    text = "".join(path.read_text(encoding="utf-8") for path in sorted(folder.rglob("*.py")))
    used = set(
        re.findall(r'"((?:host|auth|request|episode|session|recording|operator)/[a-z-]+)"', text)
    )
    raised = {code for code in CODES if len(re.findall(f'"{code}"', text)) > 1}
    assert used == set(CODES) == raised


def test_a_running_server_has_the_same_document(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (_, _, api):
            for _ in range(2):
                assert await api.get("/api/openapi.json") == openapi()

    run(main())


def test_the_guides_python_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (example,) = blocks("operator.md", "python")
    names: dict[str, Any] = {}
    exec(compile(example.replace("8766", "0"), "operator.md", "exec"), names)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROBOTOUILLE_PORT", "0")
    run(names["main"]())
    assert capsys.readouterr().out.startswith("http://127.0.0.1:")
