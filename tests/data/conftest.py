"""Databases for catalogues."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille_data.sqlite_process import answer_frames
from tests.support.postgresql import USER, PostgreSQL, missing, postgresql

OWNER = "owner"
"""Role that owns the catalogue and is no superuser."""


@pytest.fixture(autouse=True)
def _answers_without_processes(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Let quick tests answer SQLite queries in this process, without the limits."""
    if request.node.get_closest_marker("process") is not None:
        return
    query = pytest.importorskip("robotouille_data.query", reason="needs the extra `data`")

    @contextmanager
    def answer(
        uri: str, query: str, *, seconds: float, lock_seconds: float
    ) -> Iterator[tuple[list[str], Iterator[Any]]]:
        with closing(answer_frames(uri, query, lock_seconds)) as frames:
            yield list(next(frames)), frames

    monkeypatch.setattr(query, "sqlite_answer", answer)


@pytest.fixture(scope="session")
def server() -> Iterator[PostgreSQL]:
    if why := missing():
        pytest.skip(why)
    pytest.importorskip("psycopg", reason="needs the extra `data`")
    import psycopg

    with postgresql() as running:
        with psycopg.connect(running.url, autocommit=True) as connection:
            connection.execute(f"CREATE ROLE {OWNER} LOGIN")
            connection.execute(f"ALTER DATABASE postgres OWNER TO {OWNER}")
        yield running


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.process)])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """Return the path or URL of an empty database."""
    if request.param == "sqlite":
        yield str(tmp_path / "catalogue.sqlite")
        return
    import psycopg

    url = request.getfixturevalue("server").url
    yield url.replace(f"//{USER}@", f"//{OWNER}@")
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(
            f"DROP SCHEMA public CASCADE; CREATE SCHEMA public AUTHORIZATION {OWNER}"
        )
