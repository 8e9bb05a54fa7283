"""Recordings of episodes: written, read, verified and exported.

`replay.restore` makes an episode of one, which goes on where the recording ends.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.replay.analysis.measures import Measures, SeatMeasures
    from robotouille.replay.analysis.transitions import Transition
    from robotouille.replay.notes import rejection_kind, rejections
    from robotouille.replay.recorder import Recorder, header
    from robotouille.replay.recording import Recording, Verification, read_recording, recording_of
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.replay.recorder",
        "robotouille.replay.recording",
        "robotouille.replay.notes",
        "robotouille.replay.analysis.transitions",
        "robotouille.replay.analysis.measures",
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
