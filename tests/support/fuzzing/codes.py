"""The codes that a server may answer with: those of the table in docs/protocol.md."""

from __future__ import annotations

import re
from functools import cache

from tests.support.pages import read

__all__ = ["documented_codes"]

ROW = re.compile(r"^\| `([a-z]+/[a-z-]+)` \|", re.MULTILINE)


@cache
def documented_codes() -> frozenset[str]:
    """Every code of the section "Errors"."""
    _, _, errors = read("protocol.md").partition("\n## Errors\n")
    codes = frozenset(ROW.findall(errors.partition("\n## ")[0]))
    assert len(codes) > 20, "the table of error codes was not found"
    return codes
