"""Skip these tests without the extra `rl`; run the batch engine in plain Python."""

from importlib.util import find_spec

import pytest

if find_spec("gymnasium") is None or find_spec("pettingzoo") is None:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture
def in_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use the batch engine, which without a compiler runs in plain Python."""
    from robotouille.envs import rules

    monkeypatch.setattr(rules, "is_compiled", lambda: True)
