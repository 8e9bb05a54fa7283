"""Recording with every kind of event, and viewers without a screen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from tests.support.viewer_pictures import eventful
from tests.support.window_play import Timer, headless_window

from robotouille.replay.compression import compress
from robotouille.replay.recording import Recording, read_recording
from robotouille_client.window.replay.viewer import RecordingViewer


@pytest.fixture(scope="session")
def stream() -> bytes:
    return eventful()


@pytest.fixture(scope="session")
def recording(stream: bytes) -> Recording:
    return Recording(stream)


@pytest.fixture
def path(stream: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "eventful.rbt"
    path.write_bytes(compress(stream))
    return path


@pytest.fixture
def opened() -> Iterator[Callable[..., RecordingViewer]]:
    """Open viewers, each with a `timer` that stands still."""
    viewers: list[RecordingViewer] = []

    def open_viewer(*paths: Path, size: tuple[int, int] = (1280, 720)) -> RecordingViewer:
        timer = Timer()
        recordings = [(path, read_recording(path, damaged=True)) for path in paths]
        make = partial(headless_window, size)
        viewer = RecordingViewer(recordings, now=timer, make_window=make)
        viewer.timer = timer
        viewers.append(viewer)
        viewer.window.frame(viewer)
        return viewer

    yield open_viewer
    for viewer in viewers:
        viewer.close()
