"""Sounds and videos of a game."""

from __future__ import annotations

import dataclasses
import os
import sys
from pathlib import Path

import pygame
import pytest
from tests.support.window_play import SIZE, Script, Timer, headless_window, press

from robotouille import World
from robotouille.errors import MissingExtraError
from robotouille.installation import data_folder
from robotouille_client.window.input.sounds import Sounds, sounds_between
from robotouille_client.window.video import FilmOptions, frames_of, write_video
from robotouille_client.window.view import Bubble, SeatView


def received(script: Script, line: str) -> tuple[str, ...]:
    before = script.view()
    script.act(script.world.parse(script.state, script.me, line))
    return sounds_between(before, script.view())


def test_each_kind_of_action_has_a_sound() -> None:
    script = Script(World("training/01"))
    lines = [
        ("move(robot1, table4, table3)", ("walk",)),
        ("pick-up-item(robot1, tomato1, table3)", ("take",)),
        ("move(robot1, table3, board1)", ("walk",)),
        ("place-item(robot1, tomato1, board1)", ("put",)),
        ("cut(robot1, tomato1, board1)", ("work",)),
        ("wait()", ()),
        ("cut(robot1, tomato1, board1)", ()),
        ("cut(robot1, tomato1, board1)", ("ready",)),
    ]
    assert [received(script, line) for line, _ in lines] == [sounds for _, sounds in lines]


def test_sounds_of_rejections_chat_and_the_end() -> None:
    view = Script(World("training/01")).view()
    own, other = Bubble("robot1", "No."), Bubble("robot2", "No.")
    refused = dataclasses.replace(view, bubbles=(own,))
    assert sounds_between(view, refused) == ("refused",)
    assert sounds_between(refused, refused) == ()
    assert sounds_between(view, dataclasses.replace(view, bubbles=(other,))) == ()
    assert sounds_between(view, dataclasses.replace(view, chat=(("bob", "hi"),))) == ("said",)
    for won, sound in ((True, "won"), (False, "lost")):
        assert sounds_between(view, dataclasses.replace(view, outcome="x", won=won)) == (sound,)


def test_all_sounds_exist_and_are_small() -> None:
    sizes = {
        path.stem: path.stat().st_size for path in (data_folder("assets") / "sounds").iterdir()
    }
    assert sizes.pop("music") < 450_000
    assert set(sizes) == {
        "walk", "take", "put", "work", "ready", "refused", "said", "won", "lost",
    }  # fmt: skip
    assert sum(sizes.values()) < 100_000


def test_music_plays_at_its_volume_until_it_is_turned_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_AUDIODRIVER", "dummy")
    sounds = Sounds()
    try:
        for music, on, playing in ((0.3, True, 1), (0.6, True, 1), (0.6, False, 0), (0.6, True, 1),
                                   (0.0, True, 0)):  # fmt: skip
            sounds.tune(0.5, music, on=on)
            assert pygame.mixer.get_busy() == bool(playing)
        sounds.tune(0.5, 0.4, on=True)
        assert pygame.mixer.Channel(0).get_sound().get_volume() == pytest.approx(0.4, abs=0.01)
        assert sounds.toggle() == "Sound off"
        assert not pygame.mixer.get_busy()
    finally:
        sounds.close()


def test_no_error_without_a_sound_card(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(**_: object) -> None:
        raise pygame.error("no such device")

    monkeypatch.setattr(pygame.mixer, "get_init", lambda: None)
    monkeypatch.setattr(pygame.mixer, "init", broken)
    script, sounds = Script(World("training/01")), Sounds()
    sounds.follow(script.view())
    script.act(script.world.parse(script.state, script.me, "move(robot1, table4, table3)"))
    assert sounds.follow(script.view()) == ("walk",)


def test_libraries_report_no_missing_sound_card(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(**_: object) -> None:
        os.write(2, b"ALSA lib confmisc.c: cannot find card '0'\n")
        raise pygame.error("no device")

    monkeypatch.setattr(pygame.mixer, "get_init", lambda: None)
    monkeypatch.setattr(pygame.mixer, "init", fail)
    script, sounds = Script(World("training/01")), Sounds()
    sounds.follow(script.view())
    script.act(script.world.parse(script.state, script.me, "move(robot1, table4, table3)"))
    sounds.follow(script.view())
    os.write(2, b"still open")
    assert capfd.readouterr().err == "still open"


def test_a_key_turns_the_sound_off(tmp_path: Path) -> None:
    script, sounds = Script(World("training/01")), Sounds(on=False)
    window = headless_window(SIZE, clock=Timer(), sounds=sounds, screenshots=tmp_path)
    window.frame(script)
    press(window, script, pygame.K_m)
    assert sounds.on
    press(window, script, pygame.K_m)
    assert not sounds.on
    assert window.overlay(script.view()).prompt == "Sound off"


av = pytest.importorskip("av")


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_three_steps(tmp_path, play, ending: str) -> None:
    course = play(World("asynchronous/09"), "move table11", "pick-up-item", "move stove1")
    path = tmp_path / f"film.{ending}"
    frames = frames_of(
        enumerate(course),
        FilmOptions(
            size=(321, 241), frames_per_step=5, hold=2, outcome="Goal reached", max_steps=9,
            seats=lambda step: (SeatView("robot1", "Ada"),),
            bubbles=lambda step: (Bubble("robot1", "hi", "chat"),) * (step == 1),
        ),
    )  # fmt: skip
    *_, count = write_video(path, frames, fps=10)
    assert count == 4 * 5 + 2
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        decoded = list(film.decode(stream))
    assert len(decoded) == count
    assert (decoded[0].width, decoded[0].height) == (320, 240)
    assert float(decoded[-1].time) == pytest.approx((count - 1) / 10)


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_colours_survive(tmp_path, ending: str) -> None:
    surface = pygame.Surface((64, 48))
    surface.fill((200, 40, 40))
    path = tmp_path / f"red.{ending}"
    list(write_video(path, [surface] * 3, fps=10))
    with av.open(str(path)) as film:
        frame = next(film.decode(video=0)).reformat(format="rgba")
    red, green, blue = bytes(frame.planes[0])[:3]
    assert abs(red - 200) < 12
    assert abs(green - 40) < 12
    assert abs(blue - 40) < 12


def test_unwritable_videos(tmp_path) -> None:
    with pytest.raises(ValueError, match=r"\.mp4 or \.gif"):
        list(write_video(tmp_path / "film.avi", []))
    with pytest.raises(ValueError, match="at least one frame"):
        list(write_video(tmp_path / "film.mp4", []))
    assert not list(tmp_path.iterdir())


def test_without_pyav_the_extra_is_named(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[video\]"):
        list(write_video(tmp_path / "film.mp4", [pygame.Surface((8, 8))]))


def test_without_states_there_are_no_frames() -> None:
    assert list(frames_of([])) == []


def test_films_use_the_chosen_rendering(play) -> None:
    course = play(World("synchronous/01"))
    pictures = {
        pygame.image.tobytes(
            next(iter(frames_of(enumerate(course), FilmOptions(rendering=name)))), "RGB"
        )
        for name in ("", "robotouille", "chalk")
    }
    assert len(pictures) == 2
