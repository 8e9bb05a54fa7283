"""Codes that were closed unused: the newest are remembered, in any spelling."""

from __future__ import annotations

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.rooms.directory import listing
from robotouille_server.rooms.directory.listing import UnusedCode, UnusedCodes


def unused(code: str) -> UnusedCode:
    info = messages.EpisodeInfo(
        episode=code.lower(),
        code=code,
        task="x",
        clock="turn",
        phase="over",
        step=0,
        max_steps=1,
        seats=[],
        detail="nobody came",
    )
    return UnusedCode(info, "p-1")


def test_the_newest_codes_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "MAX_CODES", 2)
    codes = UnusedCodes()
    for code in ("AAAAA-AAAAA", "BBBBB-BBBBB", "CCCCC-CCCCC"):
        codes.add(unused(code))
    assert [one.info.code for one in codes] == ["BBBBB-BBBBB", "CCCCC-CCCCC"]
    codes.check("aaaaaaaaaa")
    with pytest.raises(ProtocolError, match="BBBBB-BBBBB is over before it began: nobody came"):
        codes.check("bbbbbbbbbb")
