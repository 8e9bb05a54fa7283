"""Public errors and events are documented and can be imported."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import robotouille_client
from robotouille import RobotouilleError
from robotouille_client import GameEvent, errors

ROOT = Path(__file__).resolve().parents[2]
PUBLIC = [
    "ActRejected",
    "ActResult",
    "Announced",
    "ChatReceived",
    "ChatRejected",
    "ChatRepeated",
    "Client",
    "ConnectionFailedError",
    "Game",
    "GameEnded",
    "GameEvent",
    "ObservationReceived",
    "ProtocolError",
    "RetryLaterError",
    "RobotouilleError",
    "RosterChanged",
    "StateChanged",
    "TeamTold",
    "UntrustedRedirectError",
    "connect",
]


def test_public_names() -> None:
    assert robotouille_client.__all__ == PUBLIC


def test_documented_errors_can_be_imported() -> None:
    page = (ROOT / "docs/api.md").read_text("utf-8").split("\n## Client library\n")[1]
    documented = set(re.findall(r"^\| `(\w+Error)` \|", page, re.MULTILINE))
    assert documented == {name for name in errors.__all__ if name != "RobotouilleError"}
    assert set(errors.__all__) <= set(robotouille_client.__all__)


def test_error_tree_in_the_docstring_matches_the_classes() -> None:
    drawn = re.findall(r"^ {4}([│├└─ ]*)(\w+Error)\b", errors.__doc__ or "", re.MULTILINE)
    assert {name for _, name in drawn} == set(errors.__all__)
    above: list[type] = []
    for prefix, name in drawn:
        depth = len(prefix) // 4
        kind = getattr(errors, name)
        assert depth == 0 or kind.__bases__ == (above[depth - 1],)
        above[depth:] = [kind]
    assert above[0] is RobotouilleError


def test_all_events_are_documented() -> None:
    page = (ROOT / "docs/api.md").read_text("utf-8")
    table = page.partition("| event | when |")[2].partition("\n\n")[0]
    documented = re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)
    assert set(documented) == {kind.__name__ for kind in get_args(GameEvent)}
