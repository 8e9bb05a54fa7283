"""Reports skip the long parts of frames that they do not show."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille.replay import container
from robotouille.replay.container import MAGIC, pack_frame
from robotouille.replay.recording import Recording
from robotouille.replay.timeline import course
from tests.support.games import recorded_game


def report(recording: Recording) -> list[Any]:
    """Return what `robotouille replay info` shows."""
    return [recording.measures(), recording.participants, course(recording)]


@pytest.mark.slow
def test_reports_decode_no_long_lists_of_timers(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording(recorded_game("multi_agent/01"))
    frames = [*recording.each_frame()]
    for frame in frames:
        if frame["kind"] == "step":
            frame["timers"] = {f"timer{i}": [i] for i in range(1000)}
    longer = Recording(MAGIC + b"".join(map(pack_frame, frames)))
    assert report(longer) == report(recording)

    long: list[int] = []
    real = container.unpack

    def watched(payload: bytes, *, checked: bool = False) -> dict[str, Any]:
        long.append(len(payload) > container.WHOLE)
        return real(payload, checked=checked)

    monkeypatch.setattr(container, "unpack", watched)
    report(longer)
    assert long
    assert not any(long)
    assert [frame["step"] for frame in longer.steps][-1] == longer.length
    assert len(longer.steps[0]["timers"]) == 1000
