"""Replay viewer, driven by synthetic mouse and key events."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pygame
import pytest
from tests.support.games import recorded_game
from tests.support.samples import quick_sample
from tests.support.window_play import headless_window

from robotouille.errors import RobotouilleError
from robotouille.replay.compression import compress
from robotouille.replay.container import frame_ends
from robotouille.replay.recording import read_recording
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.replay.viewer import RecordingViewer, ReplayCards

Opener = Callable[..., RecordingViewer]
SIZES = [(1280, 720), (2560, 1440), (640, 360), (320, 240)]


def press(viewer: RecordingViewer, *keys: int, mod: int = 0) -> None:
    for key in keys:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=mod, unicode=""))
        pygame.event.post(pygame.Event(pygame.KEYUP, key=key, mod=mod))
    viewer.window.frame(viewer)


def mouse(viewer: RecordingViewer, kind: int, pos: tuple[int, int]) -> None:
    more = {"rel": (0, 0), "buttons": (1, 0, 0)} if kind == pygame.MOUSEMOTION else {"button": 1}
    pygame.event.post(pygame.Event(kind, pos=pos, **more))
    viewer.window.frame(viewer)


def spot(
    viewer: RecordingViewer, share: float, strip: int = 0, row: float = 1.0
) -> tuple[int, int]:
    """Return a pixel on the lanes, at a share of their width."""
    area = viewer.strips[strip].area
    width, height = viewer.window.size
    size = layout((width // len(viewer.strips), height), 8, 8).text
    left = area.x + min(round(size * 7.5), area.width // 4)
    x = left + share * (area.right - left - size)
    return viewer.strips[strip].offset + round(x), round(
        area.bottom - size * (1.9 + 1.25) - row * size
    )


def test_clicking_and_dragging_seek(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.5))
    assert viewer.playhead.step == 20
    mouse(viewer, pygame.MOUSEMOTION, spot(viewer, 0.75))
    assert viewer.playhead.step == 30
    mouse(viewer, pygame.MOUSEMOTION, (5, 5))
    assert viewer.playhead.step == 0
    mouse(viewer, pygame.MOUSEBUTTONUP, (5, 5))
    mouse(viewer, pygame.MOUSEMOTION, spot(viewer, 0.25))
    assert viewer.playhead.step == 0
    assert viewer.view().step == 0


def button(viewer: RecordingViewer, key: int) -> tuple[int, int]:
    place = viewer.strips[0].button(key)
    assert place is not None, key
    return place


def click(viewer: RecordingViewer, pos: tuple[int, int]) -> None:
    mouse(viewer, pygame.MOUSEBUTTONDOWN, pos)
    mouse(viewer, pygame.MOUSEBUTTONUP, pos)


def test_buttons_do_everything(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    playhead, state = viewer.playhead, viewer.state
    for playing in (False, True, False):
        click(viewer, button(viewer, pygame.K_SPACE))
        assert playhead.playing is playing
    steps = {pygame.K_RIGHT: 1, pygame.K_PERIOD: 8, pygame.K_LEFT: 7, pygame.K_END: 40}
    for key, step in steps.items():
        click(viewer, button(viewer, key))
        assert playhead.step == step
    click(viewer, button(viewer, pygame.K_COMMA))
    assert playhead.step == 20
    click(viewer, button(viewer, pygame.K_i))
    click(viewer, button(viewer, pygame.K_RIGHT))
    click(viewer, button(viewer, pygame.K_o))
    assert state.span(40) == (20, 21)
    click(viewer, button(viewer, pygame.K_PLUS))
    click(viewer, button(viewer, pygame.K_PLUS))
    click(viewer, button(viewer, pygame.K_MINUS))
    assert playhead.speed == 2
    click(viewer, button(viewer, pygame.K_f))
    assert state.followed == "robot1"
    click(viewer, button(viewer, pygame.K_l))
    assert state.log
    click(viewer, button(viewer, pygame.K_l))
    assert not state.log
    click(viewer, button(viewer, pygame.K_p))
    assert path.with_name("eventful-21.png").exists()
    click(viewer, button(viewer, pygame.K_h))
    assert state.help


def test_a_held_button_repeats(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    there = button(viewer, pygame.K_RIGHT)
    mouse(viewer, pygame.MOUSEBUTTONDOWN, there)
    viewer.timer.now += 0.4
    viewer.window.frame(viewer)
    assert viewer.playhead.step == 2
    mouse(viewer, pygame.MOUSEBUTTONUP, there)
    viewer.timer.now += 5.0
    viewer.window.frame(viewer)
    assert viewer.playhead.step == 2


def test_buttons_have_tooltips(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    mouse(viewer, pygame.MOUSEMOTION, (5, 5))
    pictures = {pixels(viewer)}
    for key in (pygame.K_SPACE, pygame.K_v, pygame.K_q, pygame.K_g):
        mouse(viewer, pygame.MOUSEMOTION, button(viewer, key))
        pictures.add(pixels(viewer))
    assert len(pictures) == 5


def pixels(viewer: RecordingViewer) -> bytes:
    surface = viewer.window._display.surface
    return pygame.image.tobytes(surface, "RGB")


@pytest.mark.parametrize("way", ["Esc", "Q", "button"])
def test_the_viewer_asks_before_it_closes(path: Path, way: str) -> None:
    recordings = [(path, read_recording(path))]
    make = partial(headless_window, cards=ReplayCards())
    viewer = RecordingViewer(recordings, make_window=make)
    viewer.window.frame(viewer)
    if way == "button":
        click(viewer, button(viewer, pygame.K_q))
    else:
        press(viewer, pygame.K_ESCAPE if way == "Esc" else pygame.K_q)
    viewer.window.frame(viewer)
    assert not viewer.window.closed
    press(viewer, pygame.K_DOWN)  # Enter alone keeps watching.
    press(viewer, pygame.K_RETURN)
    assert viewer.window.closed
    assert viewer.window.answer == "menu"
    viewer.close()


def test_keys_move_the_playhead(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    step = lambda: viewer.playhead.step  # noqa: E731
    press(viewer, pygame.K_RIGHT, pygame.K_RIGHT, pygame.K_RIGHT)
    assert (step(), viewer.playhead.playing) == (3, False)
    press(viewer, pygame.K_LEFT)
    assert step() == 2
    press(viewer, pygame.K_RIGHT, mod=pygame.KMOD_LSHIFT)
    assert step() == 12
    press(viewer, pygame.K_PAGEDOWN)
    assert step() == 16
    press(viewer, pygame.K_PAGEUP, pygame.K_PAGEUP)
    assert step() == 8
    press(viewer, pygame.K_END)
    assert step() == 40
    press(viewer, pygame.K_RIGHT)
    assert step() == 40
    press(viewer, pygame.K_HOME)
    assert step() == 0
    press(viewer, pygame.K_LEFT)
    assert step() == 0


def test_a_held_arrow_repeats(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_RIGHT, mod=0, unicode=""))
    for _ in range(5):
        viewer.window.frame(viewer)
    assert viewer.playhead.step == 1
    viewer.timer.now += 0.36
    for step in (2, 3, 4):
        viewer.window.frame(viewer)
        assert viewer.playhead.step == step
        viewer.timer.now += 0.041
    pygame.event.post(pygame.Event(pygame.KEYUP, key=pygame.K_RIGHT, mod=0))
    viewer.window.frame(viewer)
    viewer.timer.now += 1.0
    viewer.window.frame(viewer)
    assert viewer.playhead.step == 4


@pytest.mark.slow
def test_a_paused_replay_is_not_redrawn(opened: Opener, path: Path) -> None:
    for paths in ([path], [path, path]):
        viewer = opened(*paths)
        press(viewer, pygame.K_RIGHT, pygame.K_RIGHT)
        for _ in range(4):
            viewer.window.frame(viewer)
        drawn = viewer.window.drawn
        for _ in range(20):
            viewer.timer.now += 1.0
            viewer.window.frame(viewer)
        assert viewer.window.drawn == drawn
        viewer.state.show_message("Written")
        viewer.window.frame(viewer)
        assert viewer.window.drawn == drawn + 1
        press(viewer, pygame.K_SPACE)
        drawn = viewer.window.drawn
        viewer.timer.now += 0.25
        viewer.window.frame(viewer)
        assert viewer.window.drawn == drawn + 1
        viewer.close()


def test_space_and_speed(opened: Opener, path: Path) -> None:
    viewer = opened(path)  # Recorded at two steps a second.
    viewer.timer.now += 2.0
    assert viewer.playhead.step == 4
    press(viewer, *[pygame.K_PLUS] * 9)
    assert viewer.playhead.speed == 16
    viewer.timer.now += 0.5
    assert viewer.playhead.step == 20
    press(viewer, *[pygame.K_MINUS] * 9)
    assert viewer.playhead.speed == 0.25
    press(viewer, pygame.K_SPACE)
    viewer.timer.now += 100.0
    assert viewer.playhead.step == 20
    press(viewer, pygame.K_SPACE)
    viewer.timer.now += 100.0
    assert viewer.view().outcome
    press(viewer, pygame.K_SPACE)
    assert viewer.playhead.step == 0


def test_jumping_between_marks(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    reached = []
    for _ in range(6):
        press(viewer, pygame.K_PERIOD)
        reached.append(viewer.playhead.step)
    assert reached == [8, 10, 13, 20, 40, 40]
    assert "No more marks" in viewer.state.message
    press(viewer, pygame.K_COMMA, pygame.K_COMMA)
    assert viewer.playhead.step == 13


def test_following_a_player_skips_the_marks_of_others(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_f, pygame.K_f)
    assert viewer.state.followed == "robot2"
    assert viewer.view().hover == "robot2"
    press(viewer, pygame.K_PERIOD)
    assert viewer.playhead.step == 20
    press(viewer, pygame.K_f)
    assert viewer.state.followed is None


def test_clicking_a_line_of_the_log_seeks(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_END, pygame.K_l)
    assert viewer.state.log
    mouse(viewer, pygame.MOUSEBUTTONDOWN, (1150, 200))
    assert 0 < viewer.playhead.step < 40
    press(viewer, pygame.K_ESCAPE)
    assert not viewer.state.log


def test_a_click_closes_the_help(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_h)
    assert viewer.state.help
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.5))
    assert not viewer.state.help
    assert viewer.playhead.step == 0


@pytest.mark.parametrize("key", quick_sample([pygame.K_p, pygame.K_F12]))
def test_pictures_are_saved_next_to_the_recording(opened: Opener, path: Path, key: int) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_RIGHT)
    for name in ("eventful-1.png", "eventful-1-2.png"):
        press(viewer, key)
        saved = path.with_name(name)
        assert pygame.image.load(saved).get_size() == (1280, 720)
        assert viewer.state.message == f"Picture saved: {saved}"


def test_an_unwritable_folder_is_reported(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    path.unlink()
    path.parent.rmdir()
    press(viewer, pygame.K_p)
    assert viewer.state.message.startswith("The picture cannot be saved in ")


def test_the_wheel_zooms_around_the_pointer(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    middle = spot(viewer, 0.5)
    mouse(viewer, pygame.MOUSEMOTION, middle)
    for _ in range(5):
        pygame.event.post(pygame.Event(pygame.MOUSEWHEEL, x=0, y=1, which=0))
        viewer.window.frame(viewer)
    press(viewer, pygame.K_END)
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.0))
    assert viewer.playhead.step > 20


@pytest.mark.parametrize("size", quick_sample((size,) for size in SIZES))
def test_everything_fits_at_all_sizes(opened: Opener, path: Path, size: tuple[int, int]) -> None:
    viewer = opened(path, size=size)
    press(viewer, pygame.K_l, pygame.K_f, pygame.K_i)
    for share in (0.0, 0.25, 1.0):
        mouse(viewer, pygame.MOUSEMOTION, spot(viewer, share))
    press(viewer, pygame.K_h, pygame.K_END)
    assert viewer.view().outcome


# Two recordings side by side


@pytest.mark.slow
def test_two_recordings_move_together(opened: Opener, path: Path, tmp_path: Path) -> None:
    shorter = tmp_path / "shorter.rbt"
    shorter.write_bytes(compress(recorded_game("multi_agent/01", steps=25)))
    viewer = opened(path, shorter)
    press(viewer, pygame.K_RIGHT)
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.75, strip=1))
    mouse(viewer, pygame.MOUSEBUTTONUP, spot(viewer, 0.75, strip=1))
    assert viewer.playhead.step == 30
    assert viewer.view().step == 30
    assert viewer.histories[1].length == 25
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.25, strip=0))
    assert viewer.playhead.step == 10
    press(viewer, pygame.K_l, pygame.K_v, pygame.K_END)
    assert "single recording" in viewer.state.message


def test_recordings_of_different_tasks_are_refused(
    opened: Opener, path: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.rbt"
    other.write_bytes(compress(recorded_game("multi_agent/02", steps=5)))
    with pytest.raises(RobotouilleError, match=r"same task.*multi_agent/01.*multi_agent/02"):
        opened(path, other)
    with pytest.raises(RobotouilleError, match="two recordings"):
        opened(path, path, path)


# Damaged recordings


def test_a_recording_without_steps(opened: Opener, tmp_path: Path) -> None:
    path = tmp_path / "none.rbt.part"
    stream = recorded_game("multi_agent/01", steps=3)
    path.write_bytes(stream[: list(frame_ends(stream))[1]])
    viewer = opened(path)
    press(viewer, pygame.K_END, pygame.K_RIGHT, pygame.K_PAGEDOWN, pygame.K_PERIOD, pygame.K_l)
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.5))
    assert viewer.view().step == 0
    assert "No end yet" in viewer.view().status


def test_an_unfinished_recording(opened: Opener, stream: bytes, tmp_path: Path) -> None:
    path = tmp_path / "open.rbt.part"
    path.write_bytes(stream[: list(frame_ends(stream))[20] + 5])
    viewer = opened(path)
    press(viewer, pygame.K_END)
    assert 0 < viewer.playhead.step < 40
    assert "No end yet" in viewer.view().status
    assert not viewer.view().outcome


@pytest.mark.slow
def test_a_truncated_recording(opened: Opener, tmp_path: Path) -> None:
    whole = compress(recorded_game("multi_agent/01", steps=900))
    path = tmp_path / "cut.rbt"
    path.write_bytes(whole[: len(whole) * 2 // 3])
    viewer = opened(path)
    press(viewer, pygame.K_END)
    assert 0 < viewer.playhead.step < 900
    assert viewer.view().status.startswith("The end is missing: ")


def test_the_last_readable_state_replaces_a_broken_one(
    opened: Opener, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer = opened(path)
    states = viewer.histories[0].states
    frame = states.frame

    def broken(step: int) -> dict[str, object]:
        return {**frame(step), "add": [10**6]} if step == 15 else frame(step)

    monkeypatch.setattr(states, "frame", broken)
    viewer.playhead.seek(14, playing=False)
    assert viewer.view().status == ""
    viewer.playhead.seek(15, playing=False)
    assert viewer.view().status.startswith("Step 15 cannot be shown. This is step 14")
    assert viewer.view().state == viewer.histories[0].state(14)
