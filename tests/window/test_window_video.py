"""Films have the right number of frames and can be decoded."""

from __future__ import annotations

import sys

import pygame
import pytest

from robotouille import World
from robotouille.errors import MissingExtraError
from robotouille_client.window.video import frames_of, write_video
from robotouille_client.window.view import Bubble, SeatView

av = pytest.importorskip("av")


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_three_steps(tmp_path, play, ending: str) -> None:
    course = play(World("asynchronous/09"), "move table11", "pick-up-item", "move stove1")
    path = tmp_path / f"film.{ending}"
    frames = frames_of(
        enumerate(course), size=(321, 241), frames_per_step=5, hold=2,
        seats=((SeatView("robot1", "Ada"),),), bubbles={1: (Bubble("robot1", "hi", "chat"),)},
        outcome="Goal reached", max_steps=9,
    )  # fmt: skip
    count = write_video(path, frames, fps=10)
    assert count == 4 * 5 + 2
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        decoded = list(film.decode(stream))
    assert len(decoded) == count
    assert (decoded[0].width, decoded[0].height) == (320, 240)
    assert float(decoded[-1].time) == pytest.approx((count - 1) / 10)


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_the_colours_come_through(tmp_path, ending: str) -> None:
    surface = pygame.Surface((64, 48))
    surface.fill((200, 40, 40))
    path = tmp_path / f"red.{ending}"
    write_video(path, [surface] * 3, fps=10)
    with av.open(str(path)) as film:
        frame = next(film.decode(video=0)).reformat(format="rgba")
    red, green, blue = bytes(frame.planes[0])[:3]
    assert abs(red - 200) < 12
    assert abs(green - 40) < 12
    assert abs(blue - 40) < 12


def test_what_cannot_be_written(tmp_path) -> None:
    with pytest.raises(ValueError, match=r"\.mp4 or \.gif"):
        write_video(tmp_path / "film.avi", [])
    with pytest.raises(ValueError, match="at least one frame"):
        write_video(tmp_path / "film.mp4", [])
    assert not list(tmp_path.iterdir())


def test_without_pyav_the_install_line_is_given(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[video\]"):
        write_video(tmp_path / "film.mp4", [pygame.Surface((8, 8))])


def test_no_states_no_frames() -> None:
    assert list(frames_of([])) == []


def test_a_film_is_drawn_with_the_rendering_that_is_chosen(play) -> None:
    course = play(World("synchronous/01"))
    pictures = {
        pygame.image.tobytes(next(iter(frames_of(enumerate(course), rendering=name))), "RGB")
        for name in ("", "robotouille", "chalk")
    }
    assert len(pictures) == 2
