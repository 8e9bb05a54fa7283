"""Background jobs of the viewer: the steps to go, and videos of clips."""

from __future__ import annotations

import json
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pygame
import pytest
from tests.support.games import recorded_game
from tests.support.window_play import Timer, post
from typer.testing import CliRunner

from robotouille.certification.certificate import Deadline
from robotouille.planning import Limits, StepsToGo
from robotouille.replay import distances
from robotouille.replay.compression import compress
from robotouille.replay.distances import coarse_first, estimates
from robotouille.replay.recording import Recording, read_recording
from robotouille_client.cli.main import app
from robotouille_client.window.replay.background import WORKERS, LineProcess
from robotouille_client.window.replay.film import RecordingExport
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory
from robotouille_client.window.replay.timeline.steps_to_go import (
    StepsCurve,
    StepsKnown,
    StepsSearch,
)
from robotouille_client.window.replay.viewer import RecordingViewer
from robotouille_client.window.replay.viewer_state import ViewerState
from robotouille_client.window.replay.workers import main

SHORT = "synchronous/01"


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "short.rbt"
    path.write_bytes(compress(recorded_game(SHORT, steps=12)))
    return path


@contextmanager
def only_small_files() -> Iterator[None]:
    """Limit files to a kilobyte, also in child processes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_estimates_contain_the_fewest_steps() -> None:
    recording = Recording(recorded_game(SHORT, steps=12))
    search, states = StepsToGo(recording.world), dict(recording.states())
    found = list(estimates(recording, 500, Deadline(600)))
    assert [step for step, _ in found] == [*coarse_first(13)] * 2
    for step, left in found:
        exact = search(states[step], Limits())
        assert exact.steps is not None
        assert left.bound <= exact.steps
        assert left.steps is None or left.steps >= exact.steps
    assert any(left.steps is not None for _, left in found)


def test_estimates_skip_steps_of_long_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording(recorded_game(SHORT, steps=12))
    whole = dict(estimates(recording, 500, Deadline(600)))
    monkeypatch.setattr(distances, "MAX_STATES", 5)
    found = dict(estimates(recording, 500, Deadline(600)))
    assert sorted(found) == [0, 4, 8, 12]
    assert all(left.bound == whole[step].bound for step, left in found.items())


def test_the_worker_prints_one_line_for_each_finding(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main("steps", str(short), "200", "600") == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {step for step, *_ in rows} == set(range(13))
    assert main("steps", str(tmp_path / "none.rbt"), "200", "600") == 1
    assert "cannot be read" in capsys.readouterr().err


def test_steps_in_words() -> None:
    assert StepsKnown(4, 4).words == "4 steps to go"
    assert StepsKnown(4, 6).words == "4 to 6 steps to go"
    assert StepsKnown(4, None).words == "at least 4 steps to go"
    assert StepsKnown(0, None, dead=True).words == "the goal is out of reach"


def searching(path: Path) -> tuple[StepsSearch, StepsCurve, ViewerState, Timer]:
    timer, curve = Timer(), StepsCurve()
    state = ViewerState(timer)
    history = RecordedHistory(read_recording(path))
    return StepsSearch(path, history, curve, state, timer), curve, state, timer


@pytest.mark.process
def test_the_curve_fills_in_the_background(short: Path) -> None:
    search, curve, state, _ = searching(short)
    search.start()
    assert curve.begun
    assert curve.known[0] == StepsKnown(8, 8), "the certificate is used at once"
    [job] = state.jobs.values()
    assert "of 13" in job.words
    assert search.wait(120)
    search.poll()
    assert len(curve.known) == 13
    assert "every step" in state.message
    assert not state.jobs
    search.start()
    assert not curve.begun, "a complete curve is hidden"
    search.close()


@pytest.mark.process
def test_files_of_the_folder_do_not_replace_libraries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "struct.py").write_text("print('not this one')")
    monkeypatch.chdir(tmp_path)
    lines: list[str] = []
    process = LineProcess(WORKERS, "steps", "none.rbt", "1", "1", on_line=lines.append)
    assert process.ended(60)
    assert process.fault.startswith("none.rbt: ")
    assert not lines


@pytest.mark.process
def test_a_search_stops_on_request_or_at_its_deadline(short: Path) -> None:
    for late in (False, True):
        search, _, state, timer = searching(short)
        search.start()
        [job] = state.jobs.values()
        if late:
            timer.now += 600.0
            search.poll()
        else:
            job.stop()
        assert not search.running
        assert not state.jobs
        assert "known for" in state.message
        search.close()


def exporting(path: Path) -> tuple[RecordingExport, ViewerState]:
    """Return an export of a recording's video, and the state of its viewer."""
    pytest.importorskip("av")
    history, state = RecordedHistory(read_recording(path)), ViewerState(lambda: 0.0)
    return RecordingExport(path, history, state, 24.0), state


@pytest.mark.process
def test_a_clip_is_saved_next_to_the_recording(short: Path) -> None:
    export, state = exporting(short)
    state.first, state.last = 3, 5
    export.start()
    assert "steps 3 to 5" in state.jobs["video"].words
    export.start()
    assert "already" in state.message
    assert export.wait(120)
    export.poll()
    assert not state.jobs
    assert state.message == f"Video saved: {short.parent / 'short-3-5.mp4'}"
    assert (short.parent / "short-3-5.mp4").stat().st_size > 1000


@pytest.mark.process
def test_a_stopped_video_leaves_nothing(short: Path) -> None:
    export, state = exporting(short)
    export.start()
    state.jobs["video"].stop()
    assert not export.running
    assert "stopped" in state.message
    assert [path.name for path in short.parent.iterdir()] == [short.name]


@pytest.mark.process
def test_a_full_disk_is_reported(short: Path) -> None:
    export, state = exporting(short)
    with only_small_files():
        export.start()
        assert export.wait(120)
    export.poll()
    assert state.message.startswith("The video cannot be saved: ")
    assert "File too large" in state.message
    assert not (short.parent / "short-0-12.mp4").exists()


def test_a_missing_extra_is_named(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    export, state = exporting(short)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    export.start()
    assert "pip install" in state.message
    assert "video" in state.message


def test_g_and_v_start_jobs(
    short: Path, opened: Callable[..., RecordingViewer], monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []
    monkeypatch.setattr(StepsSearch, "start", lambda self: started.append("steps"))
    monkeypatch.setattr(RecordingExport, "start", lambda self: started.append("video"))
    viewer = opened(short)
    post(pygame.K_i, pygame.K_RIGHT, pygame.K_RIGHT, pygame.K_o, pygame.K_g, pygame.K_v)
    viewer.window.frame(viewer)
    assert viewer.state.span(12) == (0, 2)
    assert "steps" in started


def test_a_clip_from_the_command_line(short: Path) -> None:
    av = pytest.importorskip("av")
    film = short.with_name("film.mp4")
    words = ["replay", "video", str(short), str(film), "--size", "320x240", "--speed", "24"]
    done = CliRunner().invoke(app, [*words, "--from", "2", "--to", "6"])
    assert done.exit_code == 0, done.output
    with av.open(str(film)) as container:
        assert sum(1 for _ in container.decode(video=0)) == 5 + 24
    refused = CliRunner().invoke(app, [*words, "--from", "6", "--to", "99"])
    assert refused.exit_code == 1
    assert "steps 6 to 99 are not in the recording" in refused.output


def test_a_picture_from_the_command_line(short: Path) -> None:
    picture = short.with_name("picture.png")
    words = ["replay", "play", str(short), "--screenshot", str(picture), "--at", "7"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert pygame.image.load(picture).get_size() == (1280, 720)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("nowhere/picture.png", "nowhere; create it first"),
        ("picture.xyz", "must end in .png, .jpg, .jpeg, .bmp, not 'picture.xyz'"),
        (f"{'x' * 250}.png", "x.png: cannot be written: File name too long"),
    ],
)
def test_an_unwritable_picture(short: Path, name: str, why: str) -> None:
    picture = short.parent / name
    done = CliRunner().invoke(app, ["replay", "play", str(short), "--screenshot", str(picture)])
    assert done.exit_code == 1
    assert why in done.output.replace("\n", "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_video_leaves_nothing(
    short: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def writing(draft: Path, *_: object) -> Iterator[int]:
        draft.write_bytes(b"half")
        yield 1
        signal.raise_signal(number)
        yield 2

    monkeypatch.setattr("robotouille_client.window.replay.film.write_video", writing)
    before = signal.getsignal(signal.SIGTERM)
    files = sorted(short.parent.iterdir())
    done = CliRunner().invoke(app, ["replay", "video", str(short), str(short.parent / "x.mp4")])
    assert done.exit_code != 0
    assert sorted(short.parent.iterdir()) == files
    assert signal.getsignal(signal.SIGTERM) is before
