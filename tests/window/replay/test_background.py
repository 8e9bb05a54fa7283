"""What is worked out beside the window: the steps to go, and videos of spans."""

from __future__ import annotations

import json
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pygame
import pytest
from tests.support.games import recorded_game
from tests.support.window_play import Timer
from typer.testing import CliRunner

from robotouille.certification.certificate import Deadline
from robotouille.planning import Limits, StepsToGo
from robotouille.replay.analysis.distances import coarse_first, estimates
from robotouille.replay.container import compress
from robotouille.replay.recording import Recording, read_recording
from robotouille_client.cli.main import app
from robotouille_client.window.replay.background.line_process import LineProcess
from robotouille_client.window.replay.background.span_export import SpanExport
from robotouille_client.window.replay.background.steps_search import PROGRAM, StepsSearch
from robotouille_client.window.replay.background.steps_worker import main
from robotouille_client.window.replay.history.recorded import RecordedHistory
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve, StepsKnown
from robotouille_client.window.replay.viewer import Viewer
from robotouille_client.window.replay.viewer_state import ViewerState

SHORT = "synchronous/01"


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "short.rbt"
    path.write_bytes(compress(recorded_game(SHORT, steps=12)))
    return path


@contextmanager
def only_small_files() -> Iterator[None]:
    """No file may become larger than a kilobyte, here and in programs that are started."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_estimates_are_true() -> None:
    """The fewest steps, as a search finds them, are within every range that is told."""
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


def test_the_ends_come_first_then_the_middles() -> None:
    assert list(coarse_first(9)) == [0, 8, 4, 2, 6, 1, 3, 5, 7]
    for count in (0, 1, 2, 3, 10, 643):
        assert sorted(coarse_first(count)) == list(range(count))


def test_nothing_is_told_after_the_deadline() -> None:
    recording = Recording(recorded_game(SHORT, steps=12))
    assert list(estimates(recording, 500, Deadline(-1.0))) == []


def test_the_worker_tells_a_line_a_finding(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(str(short), "200", "600") == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {step for step, *_ in rows} == set(range(13))
    assert main(str(tmp_path / "none.rbt"), "200", "600") == 1
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
def test_the_curve_fills_beside_the_window(short: Path) -> None:
    search, curve, state, _ = searching(short)
    search.start()
    assert curve.begun
    assert curve.known[0] == StepsKnown(8, 8), "the certificate is there at once"
    [job] = state.jobs.values()
    assert "of 13" in job.words
    assert search.wait(120)
    search.poll()
    assert len(curve.known) == 13
    assert "every step" in state.message
    assert not state.jobs
    search.start()
    assert not curve.begun, "it is hidden"
    search.close()


@pytest.mark.process
def test_no_file_of_the_folder_takes_the_place_of_a_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "struct.py").write_text("print('not this one')")
    monkeypatch.chdir(tmp_path)
    heard: list[str] = []
    process = LineProcess(PROGRAM, "none.rbt", "1", "1", heard=heard.append)
    assert process.ended(60)
    assert process.fault.startswith("none.rbt: ")
    assert not heard


@pytest.mark.process
def test_a_search_is_stopped_by_its_owner_and_by_the_time(short: Path) -> None:
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
        assert "known at" in state.message
        search.close()


@pytest.mark.process
def test_a_span_is_written_beside_the_recording(short: Path) -> None:
    pytest.importorskip("av")
    history, state = RecordedHistory(read_recording(short)), ViewerState(lambda: 0.0)
    state.first, state.last = 3, 5
    export = SpanExport(short, history, state, 24.0)
    export.start()
    assert "short-3-5.mp4" in state.jobs["video"].words
    export.start()
    assert "already" in state.message
    assert export.wait(120)
    export.poll()
    assert not state.jobs
    assert state.message == f"Video saved: {short.parent / 'short-3-5.mp4'}"
    assert (short.parent / "short-3-5.mp4").stat().st_size > 1000


@pytest.mark.process
def test_a_video_that_is_given_up_leaves_nothing(short: Path) -> None:
    pytest.importorskip("av")
    history, state = RecordedHistory(read_recording(short)), ViewerState(lambda: 0.0)
    export = SpanExport(short, history, state, 1.0)
    export.start()
    state.jobs["video"].stop()
    assert not export.running
    assert "given up" in state.message
    assert [path.name for path in short.parent.iterdir()] == [short.name]


@pytest.mark.process
def test_a_video_that_cannot_be_written_is_told_in_words(short: Path) -> None:
    pytest.importorskip("av")
    history, state = RecordedHistory(read_recording(short)), ViewerState(lambda: 0.0)
    export = SpanExport(short, history, state, 24.0)
    with only_small_files():
        export.start()
        assert export.wait(120)
    export.poll()
    assert state.message.startswith("No video: ")
    assert "File too large" in state.message
    assert not (short.parent / "short-0-12.mp4").exists()


def test_without_the_extra_it_says_what_to_install(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    history, state = RecordedHistory(read_recording(short)), ViewerState(lambda: 0.0)
    SpanExport(short, history, state, 24.0).start()
    assert "pip install" in state.message
    assert "video" in state.message


def test_g_and_v_begin_and_closing_stops_them(
    short: Path, opened: Callable[..., Viewer], monkeypatch: pytest.MonkeyPatch
) -> None:
    began: list[str] = []
    monkeypatch.setattr(StepsSearch, "start", lambda self: began.append("steps"))
    monkeypatch.setattr(SpanExport, "start", lambda self: began.append("video"))
    viewer = opened(short)
    keys = pygame.K_i, pygame.K_RIGHT, pygame.K_RIGHT, pygame.K_o, pygame.K_g, pygame.K_v
    for key in keys:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
    viewer.window.frame(viewer)
    assert viewer.state.span(12) == (0, 2)
    assert "steps" in began


def test_a_span_from_the_command_line(short: Path) -> None:
    av = pytest.importorskip("av")
    film = short.with_name("film.mp4")
    words = ["replay", "video", str(short), str(film), "--size", "320x240", "--speed", "24"]
    done = CliRunner().invoke(app, [*words, "--from", "2", "--to", "6"])
    assert done.exit_code == 0, done.output
    with av.open(str(film)) as container:
        assert sum(1 for _ in container.decode(video=0)) == 5 + 48
    refused = CliRunner().invoke(app, [*words, "--from", "6", "--to", "99"])
    assert refused.exit_code == 1
    assert "no span from step 6 to 99" in refused.output


def test_a_picture_from_the_command_line(short: Path) -> None:
    picture = short.with_name("picture.png")
    words = ["replay", "play", str(short), "--screenshot", str(picture), "--at", "7"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert pygame.image.load(picture).get_size() == (1280, 720)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("nowhere/picture.png", "cannot be written"),
        ("picture.xyz", "a picture's name ends in .png"),
        ("full.png", "cannot be written"),
    ],
)
def test_a_picture_that_cannot_be_written(short: Path, name: str, why: str) -> None:
    (short.parent / "full.png").symlink_to("/dev/full")
    picture = short.parent / name
    done = CliRunner().invoke(app, ["replay", "play", str(short), "--screenshot", str(picture)])
    assert done.exit_code == 1
    assert why in done.output
    assert name.rpartition("/")[2] in done.output.replace("\n", "")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("nowhere/film.mp4", "No such file"),
        ("film.avi", "'film.avi'"),
        ("large.mp4", "File too large"),
    ],
)
def test_a_video_that_cannot_be_written(short: Path, name: str, why: str) -> None:
    pytest.importorskip("av")
    words = ["replay", "video", str(short), str(short.parent / name), "--size", "160x120"]
    with only_small_files() if why == "File too large" else nullcontext():
        done = CliRunner().invoke(app, words)
    assert done.exit_code == 1
    assert isinstance(done.exception, SystemExit)
    assert why in done.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_video_that_is_interrupted_leaves_nothing(
    short: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def writing(draft: Path, *_: object) -> Iterator[int]:
        draft.write_bytes(b"half")
        yield 1
        signal.raise_signal(number)
        yield 2

    monkeypatch.setattr("robotouille_client.window.replay.film.writing_video", writing)
    before = signal.getsignal(signal.SIGTERM)
    files = sorted(short.parent.iterdir())
    done = CliRunner().invoke(app, ["replay", "video", str(short), str(short.parent / "x.mp4")])
    assert done.exit_code != 0
    assert sorted(short.parent.iterdir()) == files
    assert signal.getsignal(signal.SIGTERM) is before
