"""Databases for catalogues."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.postgresql import USER, PostgreSQL, missing, postgresql
from tests.support.sqlite_answers import answers_without_processes

__all__ = ["answers_without_processes"]

OWNER = "owner"
"""Role that owns the catalogue without being a superuser."""


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
