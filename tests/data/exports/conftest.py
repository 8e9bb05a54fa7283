"""Catalogue of a small study, and a function that exports it."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from sqlalchemy.engine import URL

from robotouille_data.database import database_url
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import ExportFormat, ExportRequest
from robotouille_data.indexing import index
from tests.support.random_study import Write, write_random_study


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of recordings with their catalogue. Tests must not change it."""
    folder = tmp_path_factory.mktemp("study")
    write_random_study(folder)
    index(database_url(None, folder), [folder])
    return folder


@pytest.fixture(scope="session")
def url(study: Path) -> URL:
    return database_url(None, study)


@pytest.fixture
def write(url: URL, tmp_path: Path) -> Write:
    """Return a function that writes an export and returns its folder."""

    def written(*formats: str, **options: Any) -> Path:
        folder = tmp_path / f"export{len(list(tmp_path.iterdir()))}"
        export(
            url, folder, ExportRequest(tuple(map(ExportFormat, formats or ["parquet"])), **options)
        )
        return folder

    return written


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return Hugging Face's `datasets`, offline and with its own cache."""
    for name, value in (("HF_HUB_OFFLINE", "1"), ("HF_DATASETS_OFFLINE", "1")):
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hub"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        datasets = pytest.importorskip("datasets")
        monkeypatch.setattr(datasets.config, "HF_DATASETS_CACHE", str(tmp_path / "hub/cache"))
        datasets.disable_progress_bars()
        yield datasets
