"""Which version of Robotouille this is."""

from __future__ import annotations

from importlib.metadata import version

__all__ = ["RELEASE", "VERSION"]

VERSION = version("robotouille")
RELEASE = f"robotouille {VERSION}"
