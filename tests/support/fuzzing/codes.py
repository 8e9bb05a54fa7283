"""The error codes that a server may send: those in the table of docs/protocol.md."""

from __future__ import annotations

import re
from functools import cache

from tests.support.pages import read

__all__ = ["documented_codes"]

ROW = re.compile(r"^\| `([a-z]+/[a-z-]+)` \|", re.MULTILINE)


@cache
def documented_codes() -> frozenset[str]:
    """Return every code of the section "Errors"."""
    _, _, errors = read("protocol.md").partition("\n## Errors\n")
    codes = frozenset(ROW.findall(errors.partition("\n## ")[0]))
    assert len(codes) > 20, "the table of error codes was not found"
    return codes
