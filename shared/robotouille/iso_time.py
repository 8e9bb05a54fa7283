"""Times in UTC as they are written for people and for other programs."""

from __future__ import annotations

import re

__all__ = ["iso_time"]

BASIC = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)Z")


def iso_time(created: str) -> str:
    """The `created` of a recording, which is in the basic form of ISO 8601, in its extended form,
    as `2026-11-22T19:13:39Z`, which sorts and compares with dates; anything else as it is."""
    return BASIC.sub(r"\1-\2-\3T\4:\5:\6Z", created) if BASIC.fullmatch(created) else created
