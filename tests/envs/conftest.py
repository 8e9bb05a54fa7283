"""All of this needs the extra `rl`."""

import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")
