"""Fixture that looks up the platform once, for the headers of the OpenAI SDK."""

from __future__ import annotations

import platform

import pytest


@pytest.fixture(scope="session", autouse=True)
def known_platform() -> None:
    """Fill the cache of `platform`, which starts a process for its first answer."""
    platform.platform()
