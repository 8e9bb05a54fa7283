"""Copy of the shipped renderings that a test may extend."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from robotouille.installation import data_folder

__all__ = ["own_renderings"]


def own_renderings(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Copy the shipped renderings, make the program use the copy, and return its folder."""
    own = folder / "renderings"
    shutil.copytree(data_folder("renderings"), own)

    def found(name: str) -> Path:
        return own if name == "renderings" else data_folder(name)

    for module in ("domain.related_files", "world.lint_renderings"):
        monkeypatch.setattr(f"robotouille.{module}.data_folder", found)
    return own
