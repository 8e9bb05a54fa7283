"""What is heard of a game, and that nothing depends on a sound card."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pygame
import pytest
from tests.support.window_play import SIZE, Script, Timer, press

from robotouille import World
from robotouille.resources import data_folder
from robotouille_client.window.hands.sounds import Sounds, sounds_between
from robotouille_client.window.view import Bubble
from robotouille_client.window.window import Window


def heard(script: Script, line: str) -> tuple[str, ...]:
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
    assert [heard(script, line) for line, _ in lines] == [sounds for _, sounds in lines]


def test_refusals_words_and_the_end() -> None:
    view = Script(World("training/01")).view()
    own, other = Bubble("robot1", "No."), Bubble("robot2", "No.")
    refused = dataclasses.replace(view, bubbles=(own,))
    assert sounds_between(view, refused) == ("refused",)
    assert sounds_between(refused, refused) == ()
    assert sounds_between(view, dataclasses.replace(view, bubbles=(other,))) == ()
    assert sounds_between(view, dataclasses.replace(view, chat=(("bob", "hi"),))) == ("said",)
    for won, sound in ((True, "won"), (False, "lost")):
        assert sounds_between(view, dataclasses.replace(view, outcome="x", won=won)) == (sound,)


def test_every_sound_is_there_and_they_are_small() -> None:
    files = list((data_folder("assets") / "sounds").glob("*.wav"))
    names = {"walk", "take", "put", "work", "ready", "refused", "said", "won", "lost"}
    assert {path.stem for path in files} == names
    assert sum(path.stat().st_size for path in files) < 100_000


def test_without_a_sound_card_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(**_: object) -> None:
        raise pygame.error("no such device")

    monkeypatch.setattr(pygame.mixer, "get_init", lambda: None)
    monkeypatch.setattr(pygame.mixer, "init", broken)
    script, sounds = Script(World("training/01")), Sounds()
    sounds.follow(script.view())
    script.act(script.world.parse(script.state, script.me, "move(robot1, table4, table3)"))
    assert sounds.follow(script.view()) == ("walk",)


def test_a_key_turns_the_sound_off(tmp_path: Path) -> None:
    script, sounds = Script(World("training/01")), Sounds(on=False)
    window = Window(SIZE, headless=True, clock=Timer(), sounds=sounds, screenshots=tmp_path)
    window.frame(script)
    press(window, script, pygame.K_m)
    assert sounds.on
    press(window, script, pygame.K_m)
    assert not sounds.on
    assert window.overlay(script.view()).prompt == "Sound is off"
    window.close()
