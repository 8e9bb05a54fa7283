"""A recording with something of everything in it, and a viewer without a screen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from tests.support.viewer_pictures import eventful
from tests.support.window_play import Timer

from robotouille.replay.container import compress
from robotouille.replay.recording import Recording, read_recording
from robotouille_client.window.replay.viewer import Viewer
from robotouille_client.window.window import Window


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
def opened() -> Iterator[Callable[..., Viewer]]:
    """Opens viewers of files, whose `timer` is a clock that stands still."""
    viewers: list[Viewer] = []

    def open_viewer(*paths: Path, size: tuple[int, int] = (1280, 720)) -> Viewer:
        timer = Timer()
        recordings = [(path, read_recording(path, damaged=True)) for path in paths]
        make = partial(Window, size, headless=True)
        viewer = Viewer(recordings, now=timer, make_window=make)
        viewer.timer = timer
        viewers.append(viewer)
        viewer.window.frame(viewer)
        return viewer

    yield open_viewer
    for viewer in viewers:
        viewer.close()
