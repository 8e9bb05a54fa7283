"""The shipped renderings in a folder of a test's own, to which it may add others."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from robotouille.resources import data_folder

__all__ = ["own_renderings"]


def own_renderings(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Copy them into a new folder, and take that for the shipped one; where it is."""
    own = folder / "renderings"
    shutil.copytree(data_folder("renderings"), own)

    def found(name: str) -> Path:
        return own if name == "renderings" else data_folder(name)

    for module in ("domain.companions", "domain.extends", "world.lint.looks"):
        monkeypatch.setattr(f"robotouille.{module}.data_folder", found)
    return own
