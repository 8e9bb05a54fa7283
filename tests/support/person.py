"""Simulated mouse and keyboard input for a window on a virtual screen."""

from __future__ import annotations

import os
import subprocess

from robotouille import GroundAction, World
from robotouille.domain.json_files import read_model
from robotouille.domain.schema import InputFile
from robotouille.installation import data_folder
from robotouille_client.window.drawing.painter import Painter
from tests.support.screens import SIZE

__all__ = ["Person"]


class Person:
    """Simulated player who clicks on stations and presses keys."""

    def __init__(self, display: str, world: World) -> None:
        self._environment = {**os.environ, "DISPLAY": display}
        self._layout = Painter().layout(SIZE, world)
        self._world = world
        inputs = read_model(data_folder("domains") / "robotouille.input.json", InputFile)
        self._clicks = {c.name: c.input_instructions.click_on for c in inputs.mouse_click_actions}
        self._keys = {k.name: k.input_instructions.key for k in inputs.keyboard_actions}

    def do(self, action: GroundAction) -> None:
        """Send the input that performs an action."""
        if action.name in self._keys:
            self._xdotool("key", self._keys[action.name])
            return
        station = action.schema.bind(action.arguments)[self._clicks[action.name]]
        tile = self._world.thing(station).tile
        assert tile is not None
        x, y = self._layout.cell(tile).center
        self._xdotool("mousemove", str(x), str(y), "click", "1")

    def _xdotool(self, *words: str) -> None:
        subprocess.run(["xdotool", *words], env=self._environment, check=True, timeout=10)
