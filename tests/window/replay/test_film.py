"""Videos of histories: complete files only, and nothing left of stopped ones."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from robotouille.errors import RobotouilleError
from robotouille.replay.recording import Recording
from robotouille_client.window.replay.film import filming
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory

av = pytest.importorskip("av")


def test_progress_ends_with_the_complete_file(recording: Recording, tmp_path: Path) -> None:
    output = tmp_path / "film.mp4"
    written = list(filming(RecordedHistory(recording), output, 24, "160x120", (0, 3)))
    counts = [done for done, _ in written]
    assert counts == sorted(counts)
    assert [total for _, total in written] == [4 + 24] * len(written)
    assert written[-1] == (28, 28)
    assert written[-2] == (27, 28), "the last frame counts when the file is complete"
    with av.open(str(output)) as film:
        assert sum(1 for _ in film.decode(video=0)) == 28
    assert list(tmp_path.iterdir()) == [output]


@pytest.mark.parametrize("before", [b"", b"another film"])
def test_stopping_leaves_earlier_files_alone(
    recording: Recording, tmp_path: Path, before: bytes
) -> None:
    output = tmp_path / "film.mp4"
    if before:
        output.write_bytes(before)
    written = filming(RecordedHistory(recording), output, 5, "160x120")
    for _ in range(5):
        next(written)
    written.close()
    assert [path.read_bytes() for path in tmp_path.iterdir()] == ([before] if before else [])


@pytest.mark.parametrize("ending", ["gif", "GIF"])
def test_a_gif_has_fewer_frames(recording: Recording, tmp_path: Path, ending: str) -> None:
    written = filming(RecordedHistory(recording), tmp_path / f"a.{ending}", 12, "160x120", (0, 3))
    assert next(written)[1] == 4 + 12
    written.close()


def test_unwritable_videos_are_refused(recording: Recording, tmp_path: Path) -> None:
    history = RecordedHistory(recording)
    with pytest.raises(RobotouilleError, match=r"film\.mp4: cannot be written: No such file"):
        list(filming(history, tmp_path / "none" / "film.mp4", 5, "160x120"))
    with pytest.raises(RobotouilleError, match="steps 3 to 400 are not in the recording"):
        list(filming(history, tmp_path / "film.mp4", 5, "160x120", (3, 400)))
    with pytest.raises(RobotouilleError, match="cannot be written: File name too long"):
        list(filming(history, tmp_path / f"{'a' * 250}.mp4", 5, "160x120"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_replaced(recording: Recording, tmp_path: Path) -> None:
    output = tmp_path / "film.mp4"
    os.mkfifo(output)
    list(filming(RecordedHistory(recording), output, 24, "160x120", (0, 1)))
    assert [path.is_file() for path in tmp_path.iterdir()] == [True]
