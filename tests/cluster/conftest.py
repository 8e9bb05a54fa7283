"""Nodes of tests. All tests are skipped where the library of NATS is not installed."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support.shared_bucket import Node, Shared

collect_ignore_glob = [] if find_spec("nats") else ["test_*.py"]


@pytest.fixture
def shared() -> Shared:
    return Shared()


@pytest.fixture
async def pair(shared: Shared, tmp_path: Path) -> tuple[Node, Node]:
    """Two nodes that have joined."""
    nodes = Node(shared, tmp_path / "a"), Node(shared, tmp_path / "b")
    for node in nodes:
        await node.secrets.join()
    return nodes
