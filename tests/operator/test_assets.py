"""The page's files are served as they are, each with its type, and nothing else is."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import pytest

from robotouille_server.admin.http.assets import page_paths
from tests.support.operator import Api, viewing
from tests.support.virtual_time import run

PAGE = files("robotouille_server.admin.http").joinpath("page")


def test_each_file_of_the_page_has_a_path() -> None:
    names = {file.name for file in PAGE.iterdir()} - {"index.html"}
    assert page_paths() - {"/"} <= {f"/{name}" for name in names}
    assert {"/"} | {f"/{name}" for name in names if name.endswith((".js", ".css"))} <= page_paths()


TYPES = {"css": "text/css; charset=utf-8", "js": "text/javascript; charset=utf-8"}
FILES = [("/", "index.html", "text/html; charset=utf-8")] + [
    (path, path[1:], TYPES[path.rpartition(".")[2]])
    for path in sorted(page_paths() - {"/"})
    if path.endswith((".css", ".js"))
]


@pytest.mark.parametrize(("path", "name", "kind"), FILES)
def test_it_is_served_as_it_is(tmp_path: Path, path: str, name: str, kind: str) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (_, _, api):
            answer = await get(api, path)
            assert (answer.status_code, answer.headers["content-type"]) == (200, kind)
            assert answer.content == PAGE.joinpath(name).read_bytes()
            assert (await get(api, "/../api.py")).status_code == 404

    async def get(api: Api, path: str):  # type: ignore[no-untyped-def]
        return await api.http.get(path)

    run(main())
