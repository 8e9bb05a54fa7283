"""The parts of a page that `robotouille replay page` has written."""

from __future__ import annotations

import base64
import gzip
import json
import re
from typing import Any

__all__ = ["FACT_NAMES", "page_data_of", "unpacked"]

FACT_NAMES = 'atoms().map(([name, ...rest]) => `${name}(${rest.join(", ")})`).sort()'
"""JavaScript that returns the names of the facts of the state before it, such as `state.`."""


def unpacked(page: str, part: str) -> str:
    """Return the text in a compressed part of a page: `modules` or `data`."""
    found = re.search(
        rf'<script type="application/octet-stream" id="{part}">([^<]*)</script>', page
    )
    assert found is not None
    return gzip.decompress(base64.b64decode(found[1])).decode()


def page_data_of(page: str) -> dict[str, Any]:
    """Return the data of a page."""
    data: dict[str, Any] = json.loads(unpacked(page, "data"))
    return data
