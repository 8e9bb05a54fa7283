"""Documentation of the operator API, and files of the page."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from robotouille_server.operator import openapi
from robotouille_server.operator.api import page_paths
from robotouille_server.operator.principal import CODES
from tests.support.operator import viewing
from tests.support.pages import DOCS, blocks, table
from tests.support.virtual_time import run, virtual


def operations(document: dict[str, Any]) -> set[str]:
    return {
        f"{method.upper()} {path}"
        for path, methods in document["paths"].items()
        for method in methods
    }


def test_openapi_document_is_current() -> None:
    kept = json.loads((DOCS / "openapi.json").read_text(encoding="utf-8"))
    assert kept == openapi(), "run: python tools/generate_docs.py"


def test_guide_lists_all_paths() -> None:
    rows = {cell for row in table("operate_a_server.md", "Operator API") for cell in row[:1]}
    assert rows == operations(openapi())


def test_guide_lists_all_error_codes() -> None:
    assert [row[0] for row in table("operate_a_server.md", "Operator API errors")] == list(CODES)


@pytest.mark.slow
@virtual
async def test_running_server_serves_the_same_document(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        for _ in range(2):
            assert await api.get("/api/openapi.json") == openapi()


def test_python_example_of_the_guide_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (example,) = blocks("operate_a_server.md", "python")
    names: dict[str, Any] = {}
    exec(compile(example.replace("8766", "0"), "operate_a_server.md", "exec"), names)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROBOTOUILLE_PORT", "0")
    run(names["main"]())
    assert capsys.readouterr().out.startswith("http://127.0.0.1:")


PAGE = files("robotouille_server.operator").joinpath("page")


TYPES = {"css": "text/css; charset=utf-8", "js": "text/javascript; charset=utf-8"}
FILES = [("/", "index.html", "text/html; charset=utf-8")] + [
    (path, path[1:], TYPES[path.rpartition(".")[2]])
    for path in sorted(page_paths() - {"/"})
    if path.endswith((".css", ".js")) and not path.startswith("/replay/")
]


@pytest.mark.parametrize(("path", "name", "kind"), FILES)
@virtual
async def test_page_file_is_served_unchanged(
    tmp_path: Path, path: str, name: str, kind: str
) -> None:
    async with viewing(tmp_path) as (_, _, api):
        answer = await api.http.get(path)
        assert (answer.status_code, answer.headers["content-type"]) == (200, kind)
        assert answer.content == PAGE.joinpath(name).read_bytes()
        assert (await api.http.get("/../api.py")).status_code == 404
