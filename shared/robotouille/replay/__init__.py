"""Recordings of episodes: writing, reading, verifying and exporting them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.replay.measures import Measures, SeatMeasures, rejection_kind, rejections
    from robotouille.replay.recorder import Recorder, header
    from robotouille.replay.recording import Recording, Verification, read_recording, recording_of
    from robotouille.replay.transitions import Transition
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.replay.recorder",
        "robotouille.replay.recording",
        "robotouille.replay.transitions",
        "robotouille.replay.measures",
    )

__all__ = [
    "Measures",
    "Recorder",
    "Recording",
    "SeatMeasures",
    "Transition",
    "Verification",
    "header",
    "read_recording",
    "recording_of",
    "rejection_kind",
    "rejections",
]
