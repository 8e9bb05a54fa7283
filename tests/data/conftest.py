"""Databases for catalogues."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.postgresql import PostgreSQL, missing, postgresql


@pytest.fixture(scope="session")
def server() -> Iterator[PostgreSQL]:
    if why := missing():
        pytest.skip(why)
    pytest.importorskip("psycopg", reason="needs the extra `data`")
    with postgresql() as running:
        yield running


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.process)])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """Return the path or URL of an empty database."""
    if request.param == "sqlite":
        yield str(tmp_path / "catalogue.sqlite")
        return
    import psycopg

    url = request.getfixturevalue("server").url
    yield url
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("DROP SCHEMA public CASCADE; CREATE SCHEMA public")
