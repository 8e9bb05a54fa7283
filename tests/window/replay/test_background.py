"""What is worked out beside the window: the steps to go, and videos of spans."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pygame
import pytest
from tests.support.games import recorded_game
from typer.testing import CliRunner

from robotouille.certification.certificate import Deadline
from robotouille.planning import Limits, StepsToGo
from robotouille.replay.analysis.distances import estimates
from robotouille.replay.container import compress
from robotouille.replay.recording import Recording, read_recording
from robotouille_client.cli.main import app
from robotouille_client.window.replay.background.span_export import SpanExport
from robotouille_client.window.replay.background.steps_search import StepsSearch
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


def test_estimates_are_true() -> None:
    """The fewest steps, as a search finds them, are within the range that is told."""
    recording = Recording(recorded_game(SHORT, steps=12))
    search = StepsToGo(recording.world)
    found = list(estimates(recording, 500, Deadline(600)))
    assert len(found) == 13
    for (_, state), left in zip(recording.states(), found, strict=True):
        exact = search(state, Limits())
        assert exact.steps is not None
        assert left.bound <= exact.steps
        assert left.steps is None or left.steps >= exact.steps
    assert any(left.steps is not None for left in found)


def test_the_worker_tells_a_line_a_state(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(str(short), "200", "600") == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(rows) == 13
    assert main(str(tmp_path / "none.rbt"), "200", "600") == 1
    assert "cannot be read" in capsys.readouterr().err


def test_steps_in_words() -> None:
    assert StepsKnown(4, 4).words == "4 steps to go"
    assert StepsKnown(4, 6).words == "4 to 6 steps to go"
    assert StepsKnown(4, None).words == "at least 4 steps to go"
    assert StepsKnown(0, None, dead=True).words == "the goal is out of reach"


@pytest.mark.process
def test_the_curve_fills_beside_the_window(short: Path) -> None:
    history, curve, state = (
        RecordedHistory(read_recording(short)),
        StepsCurve(),
        ViewerState(lambda: 0.0),
    )
    search = StepsSearch(short, history, curve, state)
    search.start()
    assert curve.begun
    assert search.wait(120)
    search.poll()
    assert len(curve.known) == 13
    assert "step 12" in state.message
    search.close()


@pytest.mark.process
def test_a_span_is_written_beside_the_recording(short: Path) -> None:
    pytest.importorskip("av")
    history, state = RecordedHistory(read_recording(short)), ViewerState(lambda: 0.0)
    state.first, state.last = 3, 5
    export = SpanExport(short, history, state, 24.0)
    export.start()
    assert "short-3-5.mp4" in state.message
    export.start()
    assert "already" in state.message
    assert export.wait(120)
    export.poll()
    assert "Written" in state.message
    assert (short.parent / "short-3-5.mp4").stat().st_size > 1000


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
