"""What was seen of a game on a server is reviewed like a recording: with steps to go and videos."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pygame
import pytest
from tests.support.window_play import Timer

from robotouille import World
from robotouille.certification.certificate import load_certificate
from robotouille.planning import read_plan
from robotouille.protocol.message_parts import SeatInfo
from robotouille.world.world import State
from robotouille_client.sansio.game_events import Changed
from robotouille_client.window.replay.background import steps_worker
from robotouille_client.window.replay.history.live import LiveHistory
from robotouille_client.window.replay.history.seen_states import SeenStates, write_states
from robotouille_client.window.replay.history_viewer import HistoryViewer
from robotouille_client.window.replay.timeline.steps_curve import StepsKnown

AREA = pygame.Rect(0, 300, 640, 60)


@dataclass
class Game:
    """What a history asks a game for."""

    world: World
    state: State
    step: int = 0
    turn: str | None = None
    outcome: dict[str, Any] | None = None

    @property
    def seats(self) -> tuple[SeatInfo, ...]:
        player = self.world.players[0]
        return (SeatInfo(player=player, name="ada", kind="human", controller="human"),)

    @property
    def clock(self) -> dict[str, Any]:
        return {"clock": "realtime", "step_rate": 12.0, "max_steps": 90}


def seen(missed: int = 0) -> LiveHistory:
    """The shortest game of a task, as seen by somebody who came after some steps."""
    world = World("synchronous/01")
    plan = read_plan("\n".join(load_certificate(world.task).plan or ()), world)
    states = [world.initial]
    for joint in plan:
        states.append(world.step(states[-1], joint).state)
    game = Game(world, states[missed], missed)
    history = LiveHistory(game, lambda: 0.0)  # type: ignore[arg-type]
    for step in range(missed + 1, len(states)):
        history.observe(Changed(step, states[step], states[step - 1], ()))
    return history


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[HistoryViewer]:
    viewer = HistoryViewer(seen(), Timer(), tmp_path / "videos" / "game")
    yield viewer
    viewer.close()


def press(viewer: HistoryViewer, key: int) -> None:
    event = pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode="")
    assert viewer.strip.handle(event, AREA)


def test_states_are_the_same_in_another_world(tmp_path: Path) -> None:
    history = seen(missed=3)
    write_states(history, tmp_path / "seen.states")
    states = SeenStates.read(tmp_path / "seen.states")
    assert states.world.task.digest == history.world.task.digest
    assert [step for step, _ in states.states()] == list(range(3, history.length + 1))
    for step, state in states.states():
        assert history.world.unpack(states.world.pack(state)) == history.state(step)


def test_the_worker_counts_steps_from_where_somebody_came(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    history = seen(missed=3)
    write_states(history, tmp_path / "seen.states")
    assert steps_worker.main(str(tmp_path / "seen.states"), "200", "600") == 0
    told = {int(line[1:].split(",")[0]) for line in capsys.readouterr().out.splitlines()}
    assert told == set(range(3, history.length + 1))
    assert steps_worker.main(str(tmp_path / "none.states"), "200", "600") == 1


@pytest.mark.process
def test_steps_to_go_are_worked_out_beside_the_window(viewer: HistoryViewer) -> None:
    press(viewer, pygame.K_g)
    assert viewer._search._curve.known[0] == StepsKnown(8, 8)
    assert viewer._search.wait(120)
    viewer.view()
    assert len(viewer._search._curve.known) == 9
    assert "every step" in viewer._viewer_state.message


def test_a_span_is_saved_while_the_window_goes_on(viewer: HistoryViewer, tmp_path: Path) -> None:
    pytest.importorskip("av")
    viewer._viewer_state.first, viewer._viewer_state.last = 2, 3
    press(viewer, pygame.K_v)
    while viewer._viewer_state.jobs:
        viewer.view()
    video = tmp_path / "videos" / "game-2-3.mp4"
    assert str(video) in viewer._viewer_state.message
    assert video.stat().st_size > 1000
    assert list(video.parent.iterdir()) == [video]


def test_a_video_that_is_given_up_leaves_nothing(viewer: HistoryViewer, tmp_path: Path) -> None:
    pytest.importorskip("av")
    for give_up in (lambda: press(viewer, pygame.K_v), viewer.close):
        press(viewer, pygame.K_v)
        viewer.view()
        give_up()
        viewer.view()
        assert not list((tmp_path / "videos").iterdir())


def test_a_folder_that_cannot_be_written_to_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    viewer = HistoryViewer(seen(), Timer(), tmp_path / "file" / "game")
    press(viewer, pygame.K_v)
    viewer.view()
    assert "No video" in viewer._viewer_state.message
    viewer.close()
