"""Join codes, and the personal links that begin with one, in one spelling.

People type codes with and without dashes, and in any case. Programs that compare, count or store
codes and tokens therefore use the spelling of this module.
"""

from __future__ import annotations

import re

_LINK = re.compile(r"([A-Z-]{6,20})\.([A-Za-z0-9_-]{22,194})", re.ASCII | re.IGNORECASE)


def plain_code(code: str) -> str:
    """Return a join code without dashes and spaces, in upper case."""
    return "".join(code.split()).replace("-", "").upper()


def link_parts(token: str) -> tuple[str, str] | None:
    """Return the plain code and the signed part of a link's token; None for other tokens."""
    found = _LINK.fullmatch(token)
    return None if found is None else (plain_code(found[1]), found[2])


def plain_token(token: str) -> str:
    """Return the only spelling under which a token is compared and counted."""
    parts = link_parts(token)
    return token if parts is None else ".".join(parts)
