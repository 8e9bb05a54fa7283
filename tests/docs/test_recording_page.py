"""docs/recording_format.md describes rejections as the software counts them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

from robotouille.replay import rejection_kind
from tests.support.pages import read

Note = Mapping[str, Any]
SECTION = read("recording_format.md").partition("## Rejections")[2].partition("\n## ")[0]
CODES = ("action/unknown", "message/too-long", "action/stale", "episode/waiting", "rate/limited")
REASONS = ("condition", "superseded", "busy", "other")


def is_malformed(note: Note) -> bool:
    code = str(note.get("code", ""))
    return code == "action/unknown" or code.startswith("message/")


CONDITIONS: Mapping[str, Callable[[Note], bool]] = {
    "`code` is `action/unknown` or begins with `message/`": is_malformed,
    "`heard` is false": lambda note: not note.get("heard", True),
    "a reason in `why` has the kind `superseded`": lambda note: any(
        why["kind"] == "superseded" for why in note["why"]
    ),
    "all others": lambda note: True,
}


def test_kind_of_a_rejection_follows_from_the_documented_fields() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \| .+ \|$", SECTION.partition("| kind |")[2], re.M)
    assert len(rows) == len(CONDITIONS)
    for code, heard, reason in product((None, *CODES), (True, False), REASONS):
        note = {"reasons": ["a reason"], "why": [{"kind": reason}]}
        note |= {} if code is None else {"code": code}
        note |= {} if heard else {"heard": False}
        documented = next(kind for kind, condition in rows if CONDITIONS[condition](note))
        assert rejection_kind(note) == documented
