"""Two people at one window: letters and arrow keys, or gamepads, each with a seat of their own."""

from __future__ import annotations

from pathlib import Path

import pygame
import pytest
from tests.support.samples import quick_sample
from tests.support.window_play import Timer, headless_window, way

from robotouille.episode import Clock
from robotouille.replay.recording import read_recording
from robotouille.world.scene import scene
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.app.local_game import COMPANION, GameSetup, LocalGame
from robotouille_client.window.app.play_menu import PlayMenu
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.input.commands import Command, Gamepads
from robotouille_client.window.window import Window

LETTERS = {
    Command.LEFT: pygame.K_a,
    Command.RIGHT: pygame.K_d,
    Command.UP: pygame.K_w,
    Command.DOWN: pygame.K_s,
}
ARROWS = {
    Command.LEFT: pygame.K_LEFT,
    Command.RIGHT: pygame.K_RIGHT,
    Command.UP: pygame.K_UP,
    Command.DOWN: pygame.K_DOWN,
}
BUTTONS = {
    Command.LEFT: pygame.CONTROLLER_BUTTON_DPAD_LEFT,
    Command.RIGHT: pygame.CONTROLLER_BUTTON_DPAD_RIGHT,
    Command.UP: pygame.CONTROLLER_BUTTON_DPAD_UP,
    Command.DOWN: pygame.CONTROLLER_BUTTON_DPAD_DOWN,
}


class Couple:
    """Game of two people in one window, without a clock of its own."""

    def __init__(self, folder: Path | None = None) -> None:
        self.timer = Timer()
        setup = GameSetup(
            "multi_agent/01", seats=2, people=2, rate=10.0, max_steps=200, countdown=0.0
        )
        self.game = LocalGame(setup, "ada", self.timer, folder, prompt_partners)
        self.source = self.game.source
        self.window: Window = headless_window(clock=self.timer)
        self.me, self.companion = self.source.view().me or "", self.source.view().companion or ""
        self.window.frame(self.source)

    def frames(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            self.timer.now += 0.05
            self.window.frame(self.source)

    def send(self, kind: int, **fields: object) -> None:
        pygame.event.post(pygame.Event(kind, **fields))
        self.window.frame(self.source)

    def press(self, key: int) -> None:
        self.send(pygame.KEYDOWN, key=key, mod=0, unicode="")
        self.send(pygame.KEYUP, key=key, mod=0)
        self.frames(2.0)

    def push(self, button: int, pad: int = 0) -> None:
        for kind in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
            self.send(kind, button=button, instance_id=pad)
        self.frames(2.0)

    def at(self, player: str) -> str | None:
        return scene(self.source.view().state)[player].at

    def held(self, player: str) -> list[str]:
        return [n for n, p in scene(self.source.view().state).items() if p.host == player]


@pytest.mark.slow
def test_letters_move_one_person_and_arrows_the_other(tmp_path: Path) -> None:
    couple = Couple(tmp_path)
    assert {seat.name for seat in couple.source.view().seats} == {"ada", COMPANION}
    before = couple.at(couple.companion)
    for command in way(couple.source.view().state, couple.me, "table4"):
        couple.press(LETTERS[command])
    assert (couple.at(couple.me), couple.at(couple.companion)) == ("table4", before)
    for command in way(couple.source.view().state, couple.companion, "table3"):
        couple.press(ARROWS[command])
    assert (couple.at(couple.me), couple.at(couple.companion)) == ("table4", "table3")
    couple.press(pygame.K_RSHIFT)
    assert couple.held(couple.companion)
    couple.press(pygame.K_e)
    assert couple.held(couple.me)
    while not couple.source.finished:
        couple.frames(1.0)
    path = couple.game.finish(ended=True)
    assert path is not None
    recording = read_recording(path)
    assert recording.verify().ok
    assert set(recording.participants.values()) == {("ada", "human"), (COMPANION, "human")}


@pytest.mark.parametrize(("pads", "pad"), quick_sample([((0,), 0), ((4, 7), 7)]))
def test_the_companion_has_the_only_gamepad_or_the_second(
    monkeypatch: pytest.MonkeyPatch, pads: tuple[int, ...], pad: int
) -> None:
    couple = Couple()
    plugged = dict.fromkeys(pads)
    monkeypatch.setattr(Gamepads, "plugged", property(lambda self: tuple(plugged)))
    before = couple.at(couple.me)
    for command in way(couple.source.view().state, couple.companion, "table3"):
        couple.push(BUTTONS[command], pad)
    assert (couple.at(couple.me), couple.at(couple.companion)) == (before, "table3")
    couple.push(pygame.CONTROLLER_BUTTON_A, pad)
    assert couple.held(couple.companion)
    if len(pads) > 1:
        for command in way(couple.source.view().state, couple.me, "table4"):
            couple.push(BUTTONS[command], pads[0])
        assert couple.at(couple.me) == "table4"


def test_keys_of_the_companion_are_let_go_while_the_other_types() -> None:
    couple = Couple()
    couple.send(pygame.KEYDOWN, key=pygame.K_RIGHT, mod=0, unicode="")
    couple.send(pygame.KEYDOWN, key=pygame.K_t, mod=0, unicode="t")
    couple.send(pygame.KEYUP, key=pygame.K_RIGHT, mod=0)
    couple.frames(4.0)
    assert couple.at(couple.companion) == "table3", "one walk, to the next table"


def test_an_unplugged_gamepad_lets_go() -> None:
    couple = Couple()
    button = BUTTONS[Command.RIGHT]
    couple.send(pygame.CONTROLLERBUTTONDOWN, button=button, instance_id=7)
    couple.send(pygame.CONTROLLERDEVICEREMOVED, instance_id=7)
    couple.frames(4.0)
    assert couple.at(couple.companion) == "table3", "one walk, to the next table"


def test_the_menu_offers_a_second_person_where_there_is_a_seat() -> None:
    menu = PlayMenu(Settings(task="multi_agent/01", seats=3))
    labels = [row.label for row in menu.form.rows]
    people = menu.form.rows[labels.index("People")]
    people.command(Command.RIGHT)
    assert menu.setup.people == 2
    assert "right Shift" in menu.form.message
    seats = menu.form.rows[labels.index("Players")]
    assert "you two and a bot" in str(seats.options)  # type: ignore[attr-defined]
    seats.command(Command.LEFT)
    assert "Bots" not in [row.label for row in menu.form.rows], "two people fill both seats"
    alone = PlayMenu(Settings(task="synchronous/01"))
    assert "People" not in [row.label for row in alone.form.rows]
    assert alone.setup.people == 1


def test_a_task_for_one_has_no_companion() -> None:
    setup = GameSetup("synchronous/01", people=2, clock=Clock.TURN)
    game = LocalGame(setup, "ada", Timer(), None, prompt_partners)
    assert game.source.view().companion is None
