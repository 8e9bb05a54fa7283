"""The SDK of endpoints names the platform in its headers, which is found out once in a process."""

from __future__ import annotations

import platform

import pytest


@pytest.fixture(scope="session", autouse=True)
def known_platform() -> None:
    """`platform` starts `uname` the first time that it is asked, and keeps the answer."""
    platform.platform()
