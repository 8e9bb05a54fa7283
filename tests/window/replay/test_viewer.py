"""The viewer by synthetic mouse and keys alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pygame
import pytest
from tests.support.games import recorded_game
from tests.support.golden_pictures import difference

from robotouille.errors import RecordingError, RobotouilleError
from robotouille.replay.container import compress, frame_ends, magic
from robotouille.replay.recording import read_recording
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.timeline.readout import readout_parts
from robotouille_client.window.replay.viewer import ReplayCards, Viewer
from robotouille_client.window.window import Window

Opener = Callable[..., Viewer]
SIZES = [(1280, 720), (2560, 1440), (640, 360), (320, 240)]


def press(viewer: Viewer, *keys: int, mod: int = 0) -> None:
    for key in keys:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=mod, unicode=""))
        pygame.event.post(pygame.Event(pygame.KEYUP, key=key, mod=mod))
    viewer.window.frame(viewer)


def mouse(viewer: Viewer, kind: int, pos: tuple[int, int]) -> None:
    more = {"rel": (0, 0), "buttons": (1, 0, 0)} if kind == pygame.MOUSEMOTION else {"button": 1}
    pygame.event.post(pygame.Event(kind, pos=pos, **more))
    viewer.window.frame(viewer)


def spot(viewer: Viewer, share: float, strip: int = 0, row: float = 1.0) -> tuple[int, int]:
    """A pixel on the lanes: a share of the way from their left to their right end."""
    area = viewer.strips[strip].area
    width, height = viewer.window.size
    size = layout((width // len(viewer.strips), height), 8, 8).text
    left = area.x + min(round(size * 7.5), area.width // 4)
    x = left + share * (area.right - left - size)
    return viewer.strips[strip].offset + round(x), round(
        area.bottom - size * (1.9 + 1.25) - row * size
    )


def test_clicks_and_drags_seek(opened: Opener, path: Path) -> None:
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


def button(viewer: Viewer, key: int) -> tuple[int, int]:
    """Where the button of a key is."""
    place = viewer.strips[0].button(key)
    assert place is not None, key
    return place


def click(viewer: Viewer, pos: tuple[int, int]) -> None:
    mouse(viewer, pygame.MOUSEBUTTONDOWN, pos)
    mouse(viewer, pygame.MOUSEBUTTONUP, pos)


def test_the_mouse_alone_does_all(opened: Opener, path: Path) -> None:
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


def test_a_button_that_is_held_goes_on(opened: Opener, path: Path) -> None:
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


def test_every_button_says_what_it_does(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    mouse(viewer, pygame.MOUSEMOTION, (5, 5))
    without = pygame.image.tobytes(viewer.window._display.surface, "RGB")
    buttons = viewer.strips[0]._buttons
    assert buttons is not None
    told = set()
    for key in (pygame.K_SPACE, pygame.K_v, pygame.K_q, pygame.K_g):
        mouse(viewer, pygame.MOUSEMOTION, button(viewer, key))
        told.add(buttons.told(button(viewer, key)))
        assert pygame.image.tobytes(viewer.window._display.surface, "RGB") != without
    assert len(told) == 4


def pixels(viewer: Viewer) -> bytes:
    surface = viewer.window._display.surface
    assert surface is not None
    return pygame.image.tobytes(surface, "RGB")


@pytest.mark.parametrize("size", [(640, 360), (1280, 720), (1920, 1080), (2560, 1080)])
def test_the_buttons_stay_where_they_are(opened: Opener, path: Path, size: tuple[int, int]) -> None:
    viewer = opened(path, size=size)
    viewer.window.frame(viewer)
    before = button(viewer, pygame.K_SPACE), button(viewer, pygame.K_q)
    viewer.strips[0].curve.begun = True
    mouse(viewer, pygame.MOUSEMOTION, (5, 5))
    assert (button(viewer, pygame.K_SPACE), button(viewer, pygame.K_q)) == before


def test_what_is_told_covers_nothing_of_the_kitchen(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    mouse(viewer, pygame.MOUSEMOTION, button(viewer, pygame.K_p))
    click(viewer, button(viewer, pygame.K_p))
    told = viewer.strips[0]._toast
    assert told is not None
    kitchen = viewer.window._painter.layout(viewer.window.size, viewer.view().world).kitchen
    assert told._area.width
    assert not told._area.colliderect(kitchen)


def test_the_button_that_was_pressed_says_no_more_what_it_does(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    there = button(viewer, pygame.K_END)
    click(viewer, there)
    mouse(viewer, pygame.MOUSEMOTION, (5, 5))
    without = pixels(viewer)
    mouse(viewer, pygame.MOUSEMOTION, there)
    assert pixels(viewer) != without
    click(viewer, there)
    mouse(viewer, pygame.MOUSEMOTION, (there[0] + 1, there[1]))
    assert pixels(viewer) == without


def test_the_log_hides_what_the_panel_tells(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    panel = viewer.window._painter.layout(viewer.window.size, viewer.view().world).panel
    spots = [(panel.centerx, y) for y in range(panel.top, panel.bottom, 10)]
    told = [viewer.window._painter.told(spot) for spot in spots]
    assert any(told)
    press(viewer, pygame.K_l)
    assert not any(viewer.window._painter.told(spot) for spot in spots)


@pytest.mark.parametrize("way", ["Esc", "Q", "button"])
def test_one_leaves_after_a_question(path: Path, way: str) -> None:
    recordings = [(path, read_recording(path))]
    make = partial(Window, headless=True, cards=ReplayCards())
    viewer = Viewer(recordings, make_window=make)
    viewer.window.frame(viewer)
    if way == "button":
        click(viewer, button(viewer, pygame.K_q))
    else:
        press(viewer, pygame.K_ESCAPE if way == "Esc" else pygame.K_q)
    viewer.window.frame(viewer)
    assert not viewer.window.closed
    press(viewer, pygame.K_DOWN)  # To go on is what Enter does, as in a game.
    press(viewer, pygame.K_RETURN)
    assert viewer.window.closed
    assert viewer.window.answer == "menu"
    viewer.close()


def test_the_end_covers_nothing_of_the_kitchen(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_END)
    end = viewer.window._display.surface.copy()
    press(viewer, pygame.K_LEFT)
    kitchen = viewer.window._painter.layout(viewer.window.size, viewer.view().world).kitchen
    middle = pygame.Rect(0, 0, kitchen.width // 2, 30)
    middle.center = kitchen.center
    before = viewer.window._display.surface
    assert difference(end.subsurface(middle), before.subsurface(middle)) < 60
    assert "Out of steps" in " ".join(
        readout_parts(viewer.histories[0], at_end(viewer), viewer.state)
    )


def at_end(viewer: Viewer) -> Playhead:
    viewer.playhead.seek(viewer.playhead.length, playing=False)
    return viewer.playhead


def test_keys_move(opened: Opener, path: Path) -> None:
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


def test_an_arrow_that_is_held_goes_on(opened: Opener, path: Path) -> None:
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


def test_a_replay_that_is_paused_is_not_drawn_again(opened: Opener, path: Path) -> None:
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
        viewer.state.tell("Written")
        viewer.window.frame(viewer)
        assert viewer.window.drawn == drawn + 1
        press(viewer, pygame.K_SPACE)
        drawn = viewer.window.drawn
        viewer.timer.now += 0.25
        viewer.window.frame(viewer)
        assert viewer.window.drawn == drawn + 1
        viewer.close()


def test_space_and_speed(opened: Opener, path: Path) -> None:
    """It was recorded at two steps a second."""
    viewer = opened(path)
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


def test_marks_are_jumped_to(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    reached = []
    for _ in range(6):
        press(viewer, pygame.K_PERIOD)
        reached.append(viewer.playhead.step)
    assert reached == [8, 10, 13, 20, 40, 40]
    assert "No mark" in viewer.state.message
    press(viewer, pygame.K_COMMA, pygame.K_COMMA)
    assert viewer.playhead.step == 13


def test_following_leaves_out_the_marks_of_others(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_f, pygame.K_f)
    assert viewer.state.followed == "robot2"
    assert viewer.view().hover == "robot2"
    press(viewer, pygame.K_PERIOD)
    assert viewer.playhead.step == 20
    press(viewer, pygame.K_f)
    assert viewer.state.followed is None


def test_the_log_is_clicked_and_closed(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_END, pygame.K_l)
    assert viewer.state.log
    mouse(viewer, pygame.MOUSEBUTTONDOWN, (1150, 200))
    assert 0 < viewer.playhead.step < 40
    press(viewer, pygame.K_ESCAPE)
    assert not viewer.state.log


def test_help_has_the_keys_of_the_viewer(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_h)
    assert viewer.state.help
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.5))
    assert not viewer.state.help
    assert viewer.playhead.step == 0


@pytest.mark.parametrize("key", [pygame.K_p, pygame.K_F12])
def test_pictures_are_saved_beside_the_recording(opened: Opener, path: Path, key: int) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_RIGHT)
    for name in ("eventful-1.png", "eventful-1-2.png"):
        press(viewer, key)
        saved = path.with_name(name)
        assert pygame.image.load(saved).get_size() == (1280, 720)
        assert viewer.state.message == f"Picture saved: {saved}"


def test_a_picture_that_cannot_be_saved_is_told(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    path.unlink()
    path.parent.rmdir()
    press(viewer, pygame.K_p)
    assert viewer.state.message.startswith("No picture: ")


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


def test_nobody_talks_in_a_recording(opened: Opener, path: Path) -> None:
    viewer = opened(path)
    press(viewer, pygame.K_t)
    press(viewer, pygame.K_END)
    assert viewer.playhead.step == 40


@pytest.mark.parametrize("size", SIZES)
def test_all_sizes_with_everything_open(opened: Opener, path: Path, size: tuple[int, int]) -> None:
    viewer = opened(path, size=size)
    press(viewer, pygame.K_l, pygame.K_f, pygame.K_i)
    for share in (0.0, 0.25, 1.0):
        mouse(viewer, pygame.MOUSEMOTION, spot(viewer, share))
    press(viewer, pygame.K_h, pygame.K_END)
    assert viewer.view().outcome


# Two side by side


def test_two_go_together_by_step(opened: Opener, path: Path, tmp_path: Path) -> None:
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
    assert "one recording" in viewer.state.message


def test_other_tasks_are_refused_in_words(opened: Opener, path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.rbt"
    other.write_bytes(compress(recorded_game("multi_agent/02", steps=5)))
    with pytest.raises(RobotouilleError, match=r"one task.*multi_agent/01.*multi_agent/02"):
        opened(path, other)
    with pytest.raises(RobotouilleError, match="two recordings"):
        opened(path, path, path)


# What is not as it should be


def test_one_without_steps(opened: Opener, tmp_path: Path) -> None:
    path = tmp_path / "none.rbt.part"
    stream = recorded_game("multi_agent/01", steps=3)
    path.write_bytes(stream[: list(frame_ends(stream))[1]])
    viewer = opened(path)
    press(viewer, pygame.K_END, pygame.K_RIGHT, pygame.K_PAGEDOWN, pygame.K_PERIOD, pygame.K_l)
    mouse(viewer, pygame.MOUSEBUTTONDOWN, spot(viewer, 0.5))
    assert viewer.view().step == 0
    assert "no end" in viewer.view().status


def test_one_that_is_being_written(opened: Opener, stream: bytes, tmp_path: Path) -> None:
    path = tmp_path / "open.rbt.part"
    path.write_bytes(stream[: list(frame_ends(stream))[20] + 5])
    viewer = opened(path)
    press(viewer, pygame.K_END)
    assert 0 < viewer.playhead.step < 40
    assert "no end" in viewer.view().status
    assert not viewer.view().outcome


def test_one_that_was_cut_in_the_middle(opened: Opener, tmp_path: Path) -> None:
    whole = compress(recorded_game("multi_agent/01", steps=2500))
    path = tmp_path / "cut.rbt"
    path.write_bytes(whole[: len(whole) * 2 // 3])
    viewer = opened(path)
    press(viewer, pygame.K_END)
    assert 0 < viewer.playhead.step < 2500
    assert viewer.view().status.startswith("The end is missing: ")


def test_one_of_another_version(tmp_path: Path) -> None:
    path = tmp_path / "new.rbt"
    path.write_bytes(magic(9) + b"\0" * 40)
    with pytest.raises(RecordingError, match="format version 9"):
        read_recording(path, damaged=True)


def test_a_state_that_makes_no_sense_is_not_shown(
    opened: Opener, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last one that does stays, and the panel says so."""
    viewer = opened(path)
    states = viewer.histories[0].states
    frame = states.frame

    def broken(step: int) -> dict[str, object]:
        return {**frame(step), "add": [10**6]} if step == 15 else frame(step)

    monkeypatch.setattr(states, "frame", broken)
    viewer.playhead.seek(14, playing=False)
    assert viewer.view().status == ""
    viewer.playhead.seek(15, playing=False)
    assert viewer.view().status.startswith("Step 15 cannot be shown, you see step 14")
    assert viewer.view().state == viewer.histories[0].state(14)
